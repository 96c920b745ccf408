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


def test_a_folder_without_a_cache_is_left_as_it_is(tmp_path):
    written(tmp_path / "search.py", 500.0)
    forget_stale(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["search.py"]


def test_a_folder_of_its_own_for_the_cache_is_looked_at_too(tmp_path, monkeypatch):
    """Under the name that numba gives it."""
    kernels = tmp_path / "some_kernels"
    source = kernels / "double.py"
    written(source, 1000.0)
    source.write_text("import numba\n@numba.njit(cache=True)\ndef double(x): return 2 * x\n")
    cache = tmp_path / "cache"
    script = "import double; double.double(1)"
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(kernels)}
    environment.pop("NUMBA_DISABLE_JIT", None)
    subprocess.run([sys.executable, "-c", script], env=environment, check=True)
    assert list(cache.rglob("*.nbi"))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(cache))
    forget_stale(kernels)
    assert list(cache.rglob("*.nbi"))
    later = source.stat().st_mtime + 1e6
    os.utime(source, (later, later))
    forget_stale(kernels)
    assert not list(cache.rglob("*.nbi"))
