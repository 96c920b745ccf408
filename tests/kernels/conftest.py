"""Kernels of tests, which call those of the project, are compiled anew when these change."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numba import config

from farpoint._kernels import compile as compiling
from farpoint._kernels import scratch

compiling.forget_stale(Path(__file__).parent, Path(compiling.__file__).parent)


class Unwritten:
    """NumPy, for `scratch`: what nobody has written yet is no number, and no index."""

    ndarray = np.ndarray
    int64 = np.int64

    @staticmethod
    def empty(shape: int | tuple[int, int], dtype: type = np.float64) -> np.ndarray:
        return np.full(shape, np.nan if dtype is np.float64 else np.iinfo(np.int64).min, dtype)


@pytest.fixture(autouse=True)
def unwritten(monkeypatch):
    """Interpreted kernels that read what they have not written get their results wrong."""
    if config.DISABLE_JIT:
        monkeypatch.setattr(scratch, "np", Unwritten)
