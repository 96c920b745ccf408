"""How much memory a run needs, whatever else the process holds."""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Callable

import pytest

from farpoint import Odometry
from farpoint.odometry import OdometryResult


def peak_bytes(run: Callable[[], object]) -> int:
    """The most that Python and NumPy hold at once while it runs.

    Python keeps thousands of freed tuples until some full collection, and the more a process holds
    the later that comes: here it comes with every frame of an odometry.
    """
    process = Odometry.process

    def tidy_process(*arguments: object, **options: object) -> OdometryResult:
        gc.collect()
        return process(*arguments, **options)

    gc.freeze()  # what other tests hold is not looked through with every frame
    tracemalloc.start()
    try:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Odometry, "process", tidy_process)
            run()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
        gc.unfreeze()
