"""How every kernel of this package is compiled."""

from __future__ import annotations

from numba import njit

__all__ = ["kernel"]

# Cached on disk; divisions follow IEEE 754 (inf and NaN), as they do in NumPy.
kernel = njit(cache=True, error_model="numpy")
