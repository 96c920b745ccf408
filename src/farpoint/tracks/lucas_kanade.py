"""Pyramidal Lucas-Kanade tracking with a forward-backward check."""

from __future__ import annotations

import numpy as np

from farpoint.tracks.constants import (
    MIN_FOUND_SHARE,
    MIN_PROBES,
    PROBE_QUANTILE,
    PROBES,
    REACH_MARGIN,
)
from farpoint.tracks.kernels.lucas_kanade import Levels, blank_workspace, follow_windows
from farpoint.tracks.kernels.windows import Termination
from farpoint.tracks.options import LucasKanadeOptions
from farpoint.tracks.pyramid import Pyramid

__all__ = ["track_points"]


def track_points(
    image0: Pyramid,
    image1: Pyramid,
    points0: np.ndarray,
    start: np.ndarray,
    options: LucasKanadeOptions,
) -> tuple[np.ndarray, np.ndarray]:
    """Track points of the first image into the second image.

    Every point is tracked forward and backward (Kalal et al., "Forward-Backward Error", ICPR 2010,
    doi:10.1109/ICPR.2010.675). The backward pass starts at ``points0 + (points1 - start)``, so that
    the initial errors of both passes have the same length. If the backward pass started at
    ``points0``, where a perfect backward pass ends, a wrong match could pass the check without any
    iteration.

    A subset of the points, the probes, is tracked first, from the coarsest level. The displacement
    of a probe is the distance between ``start`` and the position found. The 0.9 quantile of the
    displacements selects the pyramid level at which the other points start.

    Parameters
    ----------
    image0, image1 : Pyramid
        Pyramids of images of one size.
    points0 : ndarray of float64, shape (N, 2)
        Pixels in the first image.
    start : ndarray of float64, shape (N, 2)
        Initial pixels in the second image: predicted positions, or ``points0``.
    options : LucasKanadeOptions
        Window, pyramid and limits.

    Returns
    -------
    points1 : ndarray of float64, shape (N, 2)
        Pixels in the second image; NaN if the point is not found.
    found : ndarray of bool, shape (N,)
        Whether the forward-backward error of the point is within the limit.
    """
    points1 = np.full(points0.shape, np.nan)
    every = np.arange(len(points0))
    first = np.s_[:: max(len(points0) // PROBES, 1)]
    probes, others = every[first], np.delete(every, first)
    coarsest = len(image0.layout) - 1
    points1[probes] = _forward_backward(
        image0, image1, points0[probes], start[probes], coarsest, options
    )
    level = _start_level(points1[probes] - start[probes], coarsest, options)
    points1[others] = _forward_backward(
        image0, image1, points0[others], start[others], level, options
    )
    return points1, ~np.isnan(points1[:, 0])


def _start_level(offsets: np.ndarray, coarsest: int, options: LucasKanadeOptions) -> int:
    """Finest level whose window is large enough for the displacements ``offsets`` (N, 2) of probes.

    The displacement of a probe that was not found is NaN.
    """
    offset_px = np.linalg.norm(offsets, axis=1)
    offset_px = offset_px[~np.isnan(offset_px)]
    if len(offset_px) < max(MIN_PROBES, MIN_FOUND_SHARE * len(offsets)):
        return coarsest
    windows = REACH_MARGIN * np.quantile(offset_px, PROBE_QUANTILE) / (options.window_px / 2)
    return min(coarsest, max(0, int(np.ceil(np.log2(max(windows, 1.0))))))


def _forward_backward(
    image0: Pyramid,
    image1: Pyramid,
    points0: np.ndarray,
    start: np.ndarray,
    level: int,
    options: LucasKanadeOptions,
) -> np.ndarray:
    """Pixels (N, 2) in the second image; NaN where the forward-backward check fails."""
    points1 = np.empty(points0.shape)
    follow_windows(
        Levels(image0.values, image0.layout[: level + 1]),
        Levels(image1.values, image1.layout[: level + 1]),
        points0,
        start,
        Termination(options.max_iterations, options.tolerance_px),
        options.forward_backward_px,
        blank_workspace(options.window_px // 2),
        points1,
    )
    return points1
