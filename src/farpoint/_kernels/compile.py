"""How every kernel of this package is compiled: `numba.njit` with the options of this project."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numba

__all__ = [
    "AnnouncedCompilation",
    "forget_stale",
    "inlined_kernel",
    "inlined_sum",
    "inner_kernel",
    "kernel",
    "step_kernel",
    "sum_kernel",
]


def forget_stale(folder: Path, *called: Path) -> None:
    """Remove what was compiled in ``folder`` before a source changed, there or where it ``called``.

    numba looks at the file of a kernel alone, not at those of the kernels that it calls: after a
    ``git pull`` old and new ones would call each other. Where ``NUMBA_CACHE_DIR`` is set, it keeps
    them there, in a folder that is named after the sources'.
    """
    sources = (source for each in (folder, *called) for source in each.glob("*.py"))
    changed = max((source.stat().st_mtime for source in sources), default=0.0)
    kept_in = [folder / "__pycache__"]
    if cache := os.environ.get("NUMBA_CACHE_DIR"):
        kept_in += Path(cache).glob(f"{folder.name}_*")
    for index in (index for each in kept_in for index in each.glob("*.nbi")):
        with suppress(OSError):  # another process may be at it, or the folder not ours
            if index.stat().st_mtime < changed:
                index.unlink()


forget_stale(Path(__file__).parent)

_Decorator = Callable[[Callable[..., Any]], Any]
# Untyped: numba's type hints do not know all of the options that numba takes.
_njit: Any = numba.njit

# Divisions follow IEEE 754 (inf and NaN), as they do in NumPy. Said of fastmath, or a function has
# that of the caller for which it is compiled first.
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": False, "no_cfunc_wrapper": True}
# Sums in any order and fused multiply-adds; NaN and infinity stay what they are.
_SUM_OPTIONS = _OPTIONS | {"fastmath": {"reassoc", "contract", "nsz"}}
# What only kernels call has no door to Python, which takes a third of the time to compile: Python
# must not call it. Tests do, and ask for doors before they import.
_INNER = {"no_cpython_wrapper": not os.environ.get("FARPOINT_TEST_KERNELS")}

# For functions that Python calls, cached on disk.
kernel: _Decorator = partial(_njit, cache=True, nogil=True, **_OPTIONS)

# For functions that only kernels call, cached as part of the caller.
inner_kernel: _Decorator = partial(_njit, **_OPTIONS, **_INNER)

# For a part of the one kernel that calls it: it has a name, but is compiled as if written there.
step_kernel: _Decorator = partial(_njit, inline="always", **_OPTIONS)

# What the body of a loop is made of: every operation as it is written, and no call.
inlined_kernel: _Decorator = partial(_njit, forceinline=True, **_OPTIONS, **_INNER)
inlined_sum: _Decorator = partial(_njit, forceinline=True, **_SUM_OPTIONS, **_INNER)

# A loop over matches that adds several at once. For loops that write to no array: one that does
# looks where the arrays lie, and takes matches one by one where they are neighbours. Sums would
# then end in other digits.
sum_kernel: _Decorator = partial(_njit, **_SUM_OPTIONS, **_INNER)

_NOTICE_AFTER_S = 2.0  # loading compiled loops takes less


# Kernels that have been called: they are compiled, in this process.
_called: set[Any] = set()


class AnnouncedCompilation:
    """Say once on standard error what takes so long, should a loop have to be compiled first."""

    def __init__(self, loop: Callable[..., object]) -> None:
        self._loop = loop
        self._notice: threading.Timer | None = None

    def __enter__(self) -> None:
        if self._loop in _called or os.environ.get("NUMBA_DISABLE_JIT") == "1":
            return
        self._notice = threading.Timer(
            _NOTICE_AFTER_S,
            lambda: print(
                "farpoint: compiling for this machine, once", file=sys.stderr, flush=True
            ),
        )
        self._notice.daemon = True
        self._notice.start()

    def __exit__(self, *_: object) -> None:
        if self._notice is not None:
            self._notice.cancel()
            _called.add(self._loop)
