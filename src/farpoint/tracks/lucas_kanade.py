"""Points found again: pyramidal Lucas-Kanade, forward and back."""

from __future__ import annotations

import numpy as np

from farpoint._kernels.lucas_kanade import Levels, blank_workspace, follow_windows
from farpoint._kernels.windows import Patience
from farpoint.tracks.options import LucasKanadeOptions
from farpoint.tracks.pyramid import Pyramid

__all__ = ["follow"]

_SCOUTS = 40  # so many points, spread over all, tell how far off the others begin
_MIN_SCOUTS = 10
_MIN_FOUND = 0.5  # of the scouts: fewer tell nothing
_USUAL_SHARE = 0.9  # of the scouts, whose misses count as usual
# A level must reach so many times the usual miss: Lucas-Kanade is sure of a fraction of its
# window only, and the way back must not be too short to go astray on.
_MARGIN = 4.0


def follow(
    image0: Pyramid,
    image1: Pyramid,
    points0: np.ndarray,
    start: np.ndarray,
    options: LucasKanadeOptions,
) -> tuple[np.ndarray, np.ndarray]:
    """Positions in the second image of points in the first, to a fraction of a pixel.

    Every point is followed forward and back (Kalal et al., "Forward-Backward Error", ICPR 2010,
    doi:10.1109/ICPR.2010.675). The way back begins as far from its goal as the way forth did, so
    that a wrong match cannot return by starting at the answer.

    A few points go first, from the coarsest level. They tell how far from the truth `start` is;
    the others begin on a level that reaches that far.

    Parameters
    ----------
    image0, image1 : Pyramid
        Of images of one size.
    points0 : ndarray of float64, shape (N, 2)
        Pixels in the first image.
    start : ndarray of float64, shape (N, 2)
        Where to begin in the second: predicted positions, or ``points0`` again.
    options : LucasKanadeOptions
        Window, pyramid and bounds.

    Returns
    -------
    points1 : ndarray of float64, shape (N, 2)
        Pixels in the second image; NaN where not found.
    found : ndarray of bool, shape (N,)
        Whether the point came back.
    """
    points1 = np.full(points0.shape, np.nan)
    every = np.arange(len(points0))
    first = np.s_[:: max(len(points0) // _SCOUTS, 1)]
    scouts, others = every[first], np.delete(every, first)
    coarsest = len(image0.layout) - 1
    points1[scouts] = _there_and_back(
        image0, image1, points0[scouts], start[scouts], coarsest, options
    )
    level = _level_needed(points1[scouts] - start[scouts], coarsest, options)
    points1[others] = _there_and_back(
        image0, image1, points0[others], start[others], level, options
    )
    return points1, ~np.isnan(points1[:, 0])


def _level_needed(misses: np.ndarray, coarsest: int, options: LucasKanadeOptions) -> int:
    """Level to begin on, given by how much (N, 2) the scouts began off; NaN where lost."""
    miss_px = np.linalg.norm(misses, axis=1)
    miss_px = miss_px[~np.isnan(miss_px)]
    if len(miss_px) < max(_MIN_SCOUTS, _MIN_FOUND * len(misses)):
        return coarsest
    windows = _MARGIN * np.quantile(miss_px, _USUAL_SHARE) / (options.window_px / 2)
    return min(coarsest, max(0, int(np.ceil(np.log2(max(windows, 1.0))))))


def _there_and_back(
    image0: Pyramid,
    image1: Pyramid,
    points0: np.ndarray,
    start: np.ndarray,
    level: int,
    options: LucasKanadeOptions,
) -> np.ndarray:
    """Pixels (N, 2) in the second image; NaN where they do not lead back."""
    points1 = np.empty(points0.shape)
    follow_windows(
        Levels(image0.values, image0.layout[: level + 1]),
        Levels(image1.values, image1.layout[: level + 1]),
        points0,
        start,
        Patience(options.max_iterations, options.tolerance_px),
        options.forward_backward_px,
        blank_workspace(options.window_px // 2),
        points1,
    )
    return points1
