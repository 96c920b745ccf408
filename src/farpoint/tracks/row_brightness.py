"""Changes of brightness by row, which flickering light causes with a rolling shutter."""

from __future__ import annotations

import numpy as np

from farpoint.geometry.vectors import median
from farpoint.tracks.constants import (
    BRIGHTNESS_LEVEL,
    DARK_GREY,
    MAX_LOG_GAIN,
    MAX_UNEXPLAINED,
    MIN_ROW_DEVIATION,
    MIN_ROW_TRACKS,
    ROW_INLIER_RATIO,
    ROW_KNOTS,
    ROW_NEIGHBOURS,
    ROW_PENALTIES,
)
from farpoint.tracks.pyramid import Pyramid
from farpoint.tracks.tracks import Tracks

__all__ = ["normalize_rows", "remove_row_gains", "row_gains"]


def normalize_rows(image: np.ndarray) -> np.ndarray:
    """Scale the rows of an image (H, W), uint8, so that all rows have the same mean.

    The scaling removes the gains of rows, but also the differences of brightness between rows of
    the scene. The result is therefore used for coarse tracking only.
    """
    means = np.maximum(image.mean(axis=1), 1.0)
    return np.clip(np.rint(image * (110.0 / means[:, None])), 0, 255).astype(np.uint8)


def row_gains(before: Pyramid, after: Pyramid, tracks: Tracks) -> np.ndarray | None:
    """Gain (H,) of each row of ``after`` relative to ``before``; None if no gain by row is found.

    For each track, the log ratio of the grey values in ``after`` and ``before`` is compared with
    two predictions: the median log ratio of the tracks in neighbouring rows, and the median log
    ratio of all tracks. Row gains are fitted if the median absolute error of the first prediction
    is at most 0.6 times the median absolute error of the second prediction. The gains are relative
    to the median gain of all tracks.
    """
    if len(tracks) < MIN_ROW_TRACKS:
        return None
    grey0, grey1 = _means(before, tracks.points0), _means(after, tracks.points1)
    bright = np.minimum(grey0, grey1) > DARK_GREY
    order = np.argsort(tracks.points1[bright, 1], kind="stable")
    rows = tracks.points1[bright, 1][order]
    changes = np.log(grey1[bright] / grey0[bright])[order]
    if len(rows) < MIN_ROW_TRACKS:
        return None
    changes = changes - median(changes)
    deviation = median(np.abs(changes))
    if deviation < MIN_ROW_DEVIATION:
        return None
    half = ROW_NEIGHBOURS // 2
    neighbours = np.lib.stride_tricks.sliding_window_view(changes, ROW_NEIGHBOURS)
    rows, changes = rows[half:-half], changes[half:-half]
    errors = np.abs(changes - np.median(np.delete(neighbours, half, axis=1), axis=1))
    remainder = median(errors)
    if remainder > MAX_UNEXPLAINED * deviation:
        return None
    inliers = errors <= ROW_INLIER_RATIO * remainder
    rows, changes = rows[inliers], changes[inliers]
    height = after.image.shape[0]
    return np.exp(_smoothed(rows, changes, height).clip(-MAX_LOG_GAIN, MAX_LOG_GAIN))


def remove_row_gains(image: np.ndarray, gains: np.ndarray) -> np.ndarray:
    """Divide each row of an image (H, W), uint8, by its gain (H,)."""
    return np.clip(np.rint(image / gains[:, None]), 0, 255).astype(np.uint8)


def _means(pyramid: Pyramid, points: np.ndarray) -> np.ndarray:
    """Grey values (N,) of pyramid level 1 at points (N, 2), by bilinear interpolation.

    The points are given in pixels of level 0.
    """
    level = min(BRIGHTNESS_LEVEL, len(pyramid.layout) - 1)
    origin, stride, width, height = pyramid.layout[level].tolist()
    at = points / 2**level
    # At the last row or column, the neighbours are in the border around the level.
    corner = np.floor(at).astype(np.int64).clip(0, [width - 1, height - 1])
    across, down = (at - corner).clip(0.0, 1.0).T
    first = origin + corner[:, 1] * stride + corner[:, 0]
    values = pyramid.values
    above = values[first] * (1.0 - across) + values[first + 1] * across
    below = values[first + stride] * (1.0 - across) + values[first + stride + 1] * across
    return above * (1.0 - down) + below * down


def _smoothed(rows: np.ndarray, changes: np.ndarray, height: int) -> np.ndarray:
    """Log gain of every row (height,): a linear P-spline with a second-difference penalty.

    The weight of the penalty is selected by generalised cross-validation (P. Eilers, B. Marx,
    "Flexible Smoothing with B-splines and Penalties", 1996, doi:10.1214/ss/1038425655).
    """
    knots = np.linspace(rows[0], rows[-1], ROW_KNOTS)
    at = (rows - knots[0]) / (knots[1] - knots[0])
    basis = np.maximum(1.0 - np.abs(at[:, None] - np.arange(ROW_KNOTS)), 0.0)
    second_differences = np.diff(np.eye(ROW_KNOTS), 2, axis=0)
    penalty = second_differences.T @ second_differences
    normal, rhs = basis.T @ basis, basis.T @ changes
    best, values = np.inf, np.zeros(ROW_KNOTS)
    for weight in ROW_PENALTIES:
        solutions = np.linalg.solve(normal + weight * penalty, np.column_stack([normal, rhs]))
        remainder = np.sum((changes - basis @ solutions[:, -1]) ** 2)
        score = remainder / (len(rows) - np.trace(solutions)) ** 2
        if score < best:
            best, values = score, solutions[:, -1]
    return np.interp(np.arange(height), knots, values)
