"""How every kernel of this package is compiled."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numba

__all__ = ["announced_compilation", "inlined_kernel", "inner_kernel", "kernel"]

# Untyped: numba's type hints do not know all of the options that numba takes.
njit: Any = numba.njit

# Cached on disk; divisions follow IEEE 754 (inf and NaN), as they do in NumPy.
kernel = njit(cache=True, error_model="numpy", no_cfunc_wrapper=True)

# For functions that only kernels call: without a door to Python, and cached as part of the caller,
# they compile several times faster.
inner_kernel = njit(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)

# For functions called from one place with many arrays: each call would count their references.
inlined_kernel = njit(
    error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True, forceinline=True
)

_PATIENCE_S = 2.0  # loading compiled loops takes less


@contextmanager
def announced_compilation(loop: Callable[..., object]) -> Iterator[None]:
    """Say once on standard error what takes so long, should ``loop`` have to be compiled first."""
    if getattr(loop, "signatures", True):  # ready, or not compiled at all
        yield
        return
    notice = threading.Timer(
        _PATIENCE_S,
        lambda: print("farpoint: compiling for this machine, once", file=sys.stderr, flush=True),
    )
    notice.daemon = True
    notice.start()
    try:
        yield
    finally:
        notice.cancel()
