"""How every kernel of this package is compiled."""

from __future__ import annotations

from numba import njit

__all__ = ["inlined_kernel", "inner_kernel", "kernel"]

# Cached on disk; divisions follow IEEE 754 (inf and NaN), as they do in NumPy.
kernel = njit(cache=True, error_model="numpy", no_cfunc_wrapper=True)

# For functions that only kernels call: without a door to Python, and cached as part of the caller,
# they compile several times faster.
inner_kernel = njit(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)

# For functions called from one place with many arrays: each call would count their references.
inlined_kernel = njit(
    error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True, forceinline=True
)
