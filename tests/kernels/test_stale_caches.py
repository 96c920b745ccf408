"""Compiled code is removed when any kernel changes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from farpoint._kernels.compile import forget_stale


def written(path: Path, at_s: float) -> Path:
    path.parent.mkdir(exist_ok=True)
    path.write_text("")
    os.utime(path, (at_s, at_s))
    return path


def test_a_change_of_a_callee_forgets_its_callers(tmp_path):
    caller = written(tmp_path / "__pycache__" / "search.search_pose-300.py311.nbi", 1000.0)
    written(tmp_path / "search.py", 500.0)
    callee = written(tmp_path / "vectors.py", 600.0)
    forget_stale(tmp_path)
    assert caller.exists()
    written(callee, 2000.0)
    forget_stale(tmp_path)
    assert not caller.exists()


def test_a_change_in_another_folder_forgets_those_that_call_there(tmp_path):
    caller = written(tmp_path / "__pycache__" / "test_search.here-20.py311.nbi", 1000.0)
    written(tmp_path / "kernels" / "search.py", 2000.0)
    forget_stale(tmp_path)
    assert caller.exists()
    forget_stale(tmp_path, tmp_path / "kernels")
    assert not caller.exists()


def test_a_change_of_one_file_in_another_folder_forgets_those_that_read_it(tmp_path):
    """Such as the constants of a package, whose other modules no kernel reads."""
    kernels = tmp_path / "kernels"
    source = written(kernels / "window.py", 500.0)
    caller = written(kernels / "__pycache__" / "window.locate-20.py311.nbi", 1000.0)
    constants = written(tmp_path / "constants.py", 600.0)
    written(tmp_path / "path.py", 2000.0)
    forget_stale(kernels, constants)
    assert caller.exists()
    written(constants, 2000.0)
    forget_stale(kernels, constants)
    assert not caller.exists()
    assert source.exists()


def test_a_folder_without_a_cache_is_left_as_it_is(tmp_path):
    written(tmp_path / "search.py", 500.0)
    forget_stale(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["search.py"]


def compiled(kernels: Path, cache: Path) -> Path:
    """Compile a kernel of a new folder into ``cache`` and return the index file of the kernel."""
    before = set(cache.rglob("*.nbi"))
    source = written(kernels / "double.py", 1000.0)
    source.write_text("import numba\n@numba.njit(cache=True)\ndef double(x): return 2 * x\n")
    script = "import double; double.double(1)"
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(kernels)}
    environment.pop("NUMBA_DISABLE_JIT", None)
    subprocess.run([sys.executable, "-c", script], env=environment, check=True)
    (index,) = set(cache.rglob("*.nbi")) - before
    return index


def test_a_folder_of_its_own_for_the_cache_is_looked_at_too(tmp_path, monkeypatch):
    """Under the name that numba gives it."""
    kernels, cache = tmp_path / "some_kernels", tmp_path / "cache"
    index = compiled(kernels, cache)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(cache))
    forget_stale(kernels)
    assert index.exists()
    later = index.stat().st_mtime + 1e6
    os.utime(kernels / "double.py", (later, later))
    forget_stale(kernels)
    assert not index.exists()


def test_kernels_of_another_package_are_left_to_that_package(tmp_path, monkeypatch):
    """Their folders have the same name, and their caches stand side by side."""
    tracks, path = tmp_path / "tracks" / "kernels", tmp_path / "path" / "kernels"
    tracks.parent.mkdir()
    path.parent.mkdir()
    cache = tmp_path / "cache"
    of_tracks, of_path = compiled(tracks, cache), compiled(path, cache)
    assert of_tracks.parent.parent == of_path.parent.parent
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(cache))
    later = of_path.stat().st_mtime + 1e6
    os.utime(tracks / "double.py", (later, later))
    forget_stale(path)
    assert of_tracks.exists()
    forget_stale(tracks)
    assert not of_tracks.exists()
    assert of_path.exists()
