"""Compilation of the kernels: `numba.njit` with the options of this project."""

from __future__ import annotations

import hashlib
import os
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numba

from farpoint._kernels.constants import COMPILE_NOTICE_S

__all__ = [
    "SHARED_KERNELS",
    "AnnouncedCompilation",
    "forget_stale",
    "inlined_kernel",
    "inner_kernel",
    "kernel",
    "loop_kernel",
    "step_kernel",
    "sum_kernel",
]


# Folder of the kernels that the kernels of every package may call.
SHARED_KERNELS = Path(__file__).parent


def forget_stale(folder: Path, *called: Path) -> None:
    """Remove compiled code of ``folder`` that is older than a source file on which it may depend.

    The source files are those in ``folder`` and those of ``called``, which lists folders and files.
    numba checks only the file of a kernel itself for changes, not the files of the kernels that
    this kernel calls, although their machine code is part of the cached code. After a ``git pull``,
    the cached code of a kernel could therefore contain the old code of a kernel from another file.
    """
    sources = (
        source
        for each in (folder, *called)
        for source in (each.glob("*.py") if each.is_dir() else [each])
    )
    changed = max((source.stat().st_mtime for source in sources), default=0.0)
    kept_in = [folder / "__pycache__"]
    if cache := os.environ.get("NUMBA_CACHE_DIR"):
        kept_in.append(Path(cache) / _cache_name(folder))
    for index in (index for each in kept_in for index in each.glob("*.nbi")):
        with suppress(OSError):  # a file in use by another process, or a read-only folder
            if index.stat().st_mtime < changed:
                index.unlink()


def _cache_name(folder: Path) -> str:
    """Name that numba gives to the cache of a folder of sources within ``NUMBA_CACHE_DIR``.

    The hash distinguishes folders of the same name, such as the folders ``kernels`` of two
    packages, or the same folder of two installations.
    """
    path = os.path.abspath(folder)  # noqa: PTH100 - as numba does: a link is not resolved
    return f"{folder.name}_{hashlib.sha1(path.encode(), usedforsecurity=False).hexdigest()}"


forget_stale(SHARED_KERNELS)

_Decorator = Callable[[Callable[..., Any]], Any]
# Untyped: numba's type hints lack some of its options.
_njit: Any = numba.njit

# A division by 0 gives infinity or NaN, as in NumPy. ``fastmath`` is explicit, because by default a
# function takes the setting of the caller for which the function is compiled first.
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": False, "no_cfunc_wrapper": True}
# LLVM may reorder sums and fuse products with sums; NaN and infinity keep their meaning.
_SUM_OPTIONS = _OPTIONS | {"fastmath": {"reassoc", "contract", "nsz"}}
# Kernels that only kernels call are compiled without the wrapper for calls from Python, which would
# take 1/3 of the compile time. Tests call these kernels from Python: they set FARPOINT_TEST_KERNELS
# before the import, so that the wrappers are compiled.
_INNER = {"no_cpython_wrapper": not os.environ.get("FARPOINT_TEST_KERNELS")}

# Called by Python: cached on disk.
kernel: _Decorator = partial(_njit, cache=True, nogil=True, **_OPTIONS)

# Called by kernels only: cached as part of the caller.
inner_kernel: _Decorator = partial(_njit, **_OPTIONS, **_INNER)

# Called by kernels only: numba copies the body into each caller, and compiles the copy with the
# options of the caller.
step_kernel: _Decorator = partial(_njit, inline="always", **_OPTIONS)

# Body of a loop, inlined by LLVM. Operations are neither reordered nor fused.
inlined_kernel: _Decorator = partial(_njit, forceinline=True, **_OPTIONS, **_INNER)

# A loop over matches whose sums LLVM may vectorise, which changes the order of the additions. Only
# for loops that write to no array: a loop that writes checks at run time whether the arrays
# overlap, and adds one match at a time if the arrays are neighbours in memory, so the last digits
# of sums would depend on addresses. LLVM always inlines the loop into the caller. A second copy,
# compiled outside the caller, could add in another order. A process that compiles the caller would
# use one of the two copies, a process that loads the compiled caller from the disk the other copy,
# and their results would differ.
sum_kernel: _Decorator = partial(_njit, forceinline=True, **_SUM_OPTIONS, **_INNER)

# Called by Python: loops that may add in any order, such as those over the observations of a
# window, and that write to arrays. Cached on disk, as `kernel`.
loop_kernel: _Decorator = partial(_njit, cache=True, nogil=True, **_SUM_OPTIONS)


# Names of the steps of a computation that this process has finished, so that their kernels are
# compiled.
_done: set[str] = set()
_has_announced = threading.Event()


class AnnouncedCompilation:
    """Context manager that prints a notice, once per process, if kernels are compiled inside.

    The code inside is one step of a computation. A step that takes longer than `COMPILE_NOTICE_S`
    is taken as a compilation. The notice goes to standard error.

    Parameters
    ----------
    step : str
        Name of a step of the computation. Only the first step with this name in a process is timed.
    """

    def __init__(self, step: str) -> None:
        self._step = step
        self._notice: threading.Timer | None = None

    def __enter__(self) -> None:
        if self._step in _done or os.environ.get("NUMBA_DISABLE_JIT") == "1":
            return
        self._notice = threading.Timer(COMPILE_NOTICE_S, _announce)
        self._notice.daemon = True
        self._notice.start()

    def __exit__(self, *_: object) -> None:
        if self._notice is not None:
            self._notice.cancel()
            _done.add(self._step)


def _announce() -> None:
    if not _has_announced.is_set():
        _has_announced.set()
        print("farpoint: compiling for this machine, once", file=sys.stderr, flush=True)
