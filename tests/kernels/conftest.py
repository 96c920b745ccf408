"""Kernels of tests, which call those of the project, are compiled anew when these change."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import numpy.ma  # reads the docstring of numpy.empty, replaced below
import pytest

from farpoint._kernels import compile as compiling

compiling.forget_stale(Path(__file__).parent, Path(compiling.__file__).parent)


_EMPTY = np.empty


def _unwritten(shape: int | tuple[int, ...], dtype: type = float, **options: Any) -> np.ndarray:
    """What nobody has written yet is no number, and no index."""
    array = _EMPTY(shape, dtype, **options)
    if array.dtype == np.float64:
        array.fill(np.nan)
    elif array.dtype == np.int64:
        array.fill(np.iinfo(np.int64).min)
    return array


@pytest.fixture(autouse=True)
def unwritten(monkeypatch):
    """Interpreted kernels that read what they have not written get their results wrong."""
    if os.environ.get("NUMBA_DISABLE_JIT") == "1":
        monkeypatch.setattr(np, "empty", _unwritten)
