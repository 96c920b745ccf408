"""Copy and fill small arrays."""

from __future__ import annotations

import numpy as np

from farpoint._kernels.compile import inner_kernel

__all__ = ["clear", "copy"]


@inner_kernel
def copy(source: np.ndarray, target: np.ndarray) -> None:
    """``target[...] = source`` for arrays in C order with the same number of elements."""
    for i in range(target.size):
        target.flat[i] = source.flat[i]


@inner_kernel
def clear(target: np.ndarray) -> None:
    """``target[...] = 0``."""
    for i in range(target.size):
        target.flat[i] = 0.0
