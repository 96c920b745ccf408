"""Runs of all estimators in turn on the same matches, so that other load affects all equally."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass

import numpy as np

from farpoint.bench.estimators import Estimator, Motion, load_peer
from farpoint.bench.views import TwoViews

__all__ = ["EstimatorRun", "one_thread", "run_interleaved"]

_REPEATED_BELOW_S = 0.02


@dataclass(frozen=True, kw_only=True, eq=False)
class EstimatorRun:
    """Results of one estimator for V pairs of views.

    Attributes
    ----------
    estimator : Estimator
    rotations : ndarray, shape (V, 3, 3)
        ``R_cam1_from_cam0``; NaN where the estimate is missing.
    directions : ndarray, shape (V, 3)
        Unit vectors ``direction_cam1_from_cam0``; NaN where the estimate is missing.
    seconds, first_seconds : ndarray, shape (V,)
        Shortest time of a call on each pair, and time of the first call on each pair, which runs
        with cold caches, s.
    """

    estimator: Estimator
    rotations: np.ndarray
    directions: np.ndarray
    seconds: np.ndarray
    first_seconds: np.ndarray


def run_interleaved(
    estimators: Sequence[Estimator],
    views: Sequence[TwoViews],
    *,
    seed: int,
    repeats: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> list[EstimatorRun]:
    """Run every estimator on every pair of views, interleaved.

    The conversion of the matches to the input of a library is not timed. Before timing begins, each
    estimator runs once on the first pair of views, so that no loading or compilation is timed.

    Parameters
    ----------
    estimators : sequence of Estimator
    views : sequence of TwoViews
        Pairs of views; at least one.
    seed : int
        Seed that every estimator gets in every call.
    repeats : int
        Number of timed calls of each estimator on each pair; the shortest time is used. Calls of
        more than 20 ms are not repeated.
    progress : callable
        Called after each pair of views with the number of finished pairs and the number of all
        pairs.
    """
    shape = (len(estimators), len(views))
    rotations = np.full((*shape, 3, 3), np.nan)
    directions = np.full((*shape, 3), np.nan)
    seconds, first_seconds = np.empty((2, *shape))
    with one_thread():
        for estimator in estimators:
            estimator.prepare(views[0], seed)()
        for column, pair in enumerate(views):
            for row, estimator in enumerate(estimators):
                estimate = estimator.prepare(pair, seed)
                motion, first_seconds[row, column], seconds[row, column] = _timed(estimate, repeats)
                if motion is not None:
                    rotations[row, column] = motion.rotation_cam1_from_cam0
                    if motion.direction_cam1_from_cam0 is not None:
                        directions[row, column] = motion.direction_cam1_from_cam0
            if progress is not None:
                progress(column + 1, len(views))
    return [
        EstimatorRun(estimator=e, rotations=R, directions=t, seconds=s, first_seconds=f)
        for e, R, t, s, f in zip(
            estimators, rotations, directions, seconds, first_seconds, strict=True
        )
    ]


def _timed(
    estimate: Callable[[], Motion | None], repeats: int
) -> tuple[Motion | None, float, float]:
    """The result of a call, and the times of the first and of the fastest call."""
    first = best = np.inf
    motion = None
    for call in range(repeats):
        start = time.perf_counter()
        motion = estimate()
        seconds = time.perf_counter() - start
        first = seconds if call == 0 else first
        best = min(best, seconds)
        if best > _REPEATED_BELOW_S:
            break
    return motion, first, best


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit OpenCV and NumPy's BLAS to one thread; the other libraries use one thread by default.

    The threads of BLAS are limited where ``threadpoolctl`` is installed.
    """
    cv2, pools = load_peer("cv2"), load_peer("threadpoolctl")
    threads = cv2.getNumThreads() if cv2 else 0
    if cv2:
        cv2.setNumThreads(1)
    try:
        with pools.threadpool_limits(1) if pools else nullcontext():
            yield
    finally:
        if cv2:
            cv2.setNumThreads(threads)
