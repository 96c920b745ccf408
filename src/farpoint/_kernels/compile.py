"""How every kernel of this package is compiled."""

from __future__ import annotations

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
    "inner_kernel",
    "kernel",
    "sum_kernel",
]


def forget_stale(folder: Path, *called: Path) -> None:
    """Remove what was compiled in ``folder`` before a source changed, there or where it ``called``.

    numba looks at the file of a kernel alone, not at those of the kernels that it calls: after a
    ``git pull`` old and new ones would call each other.
    """
    sources = (source for each in (folder, *called) for source in each.glob("*.py"))
    changed = max((source.stat().st_mtime for source in sources), default=0.0)
    for index in (folder / "__pycache__").glob("*.nbi"):
        with suppress(OSError):  # another process may be at it, or the folder not ours
            if index.stat().st_mtime < changed:
                index.unlink()


forget_stale(Path(__file__).parent)

# Untyped: numba's type hints do not know all of the options that numba takes.
njit: Any = numba.njit

# Divisions follow IEEE 754 (inf and NaN), as they do in NumPy. Said of fastmath, or a function has
# that of the caller for which it is compiled first.
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True, "fastmath": False}
# Sums in any order and fused multiply-adds; NaN and infinity stay what they are.
_SUM_OPTIONS = _OPTIONS | {"fastmath": {"reassoc", "contract", "nsz"}}
_INNER: dict[str, Any] = {"no_cpython_wrapper": True}

try:
    from farpoint._kernels.linking import InnerCompiler, with_door
except (ImportError, AttributeError):  # a numba with other inner parts compiles in its own way
    with_door = None
else:
    _INNER["pipeline_class"] = InnerCompiler


def _called_by_python(options: dict[str, Any], function: Callable[..., object]) -> Any:
    if with_door is None:
        return njit(function, cache=True, **options)
    return with_door(njit(function, **options, **_INNER))


# For functions that Python calls, cached on disk.
kernel = partial(_called_by_python, _OPTIONS)

# For functions that only kernels call, cached as part of the caller.
inner_kernel = njit(**_OPTIONS, **_INNER)

# What the body of a loop is made of: every operation as it is written, and no call, which would
# count the references of each array, and hand over all that is known of it, number by number.
inlined_kernel = njit(**_OPTIONS, **_INNER, forceinline=True)

# A loop over matches that adds several at once. For loops that write to no array: one that does
# looks where the arrays lie, and takes matches one by one where they are neighbours. Sums would
# then end in other digits.
sum_kernel = partial(_called_by_python, _SUM_OPTIONS)

_PATIENCE_S = 2.0  # loading compiled loops takes less


class AnnouncedCompilation:
    """Say once on standard error what takes so long, should a loop have to be compiled first."""

    def __init__(self, loop: Callable[..., object]) -> None:
        # Ready, or not compiled at all.
        self._is_ready = bool(getattr(loop, "overloads", True))
        self._notice: threading.Timer | None = None

    def __enter__(self) -> None:
        if self._is_ready:
            return
        self._notice = threading.Timer(
            _PATIENCE_S,
            lambda: print(
                "farpoint: compiling for this machine, once", file=sys.stderr, flush=True
            ),
        )
        self._notice.daemon = True
        self._notice.start()

    def __exit__(self, *_: object) -> None:
        if self._notice is not None:
            self._notice.cancel()
