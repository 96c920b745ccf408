"""What was compiled is forgotten when any kernel changes."""

from __future__ import annotations

import os
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
