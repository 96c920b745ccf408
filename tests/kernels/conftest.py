"""Kernels of tests, which call those of the project, are compiled anew when these change."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import numpy.ma  # reads the docstring of numpy.empty, replaced below
import pytest

import farpoint
from farpoint._kernels.compile import SHARED_KERNELS, forget_stale

_SOURCES = Path(farpoint.__file__).parent
forget_stale(
    Path(__file__).parent,
    SHARED_KERNELS,
    *_SOURCES.glob("*/kernels"),
    *_SOURCES.glob("*/constants.py"),
)


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
