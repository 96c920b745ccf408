"""Bands of brightness that run over an image: mains light read by a rolling shutter."""

from __future__ import annotations

import numpy as np

from farpoint.tracks.pyramid import Pyramid
from farpoint.tracks.tracks import Tracks

__all__ = ["even_rows", "row_gains", "with_row_gains"]

_LEVEL = 1  # of the pyramids, whose pixels are means over a few
_NEIGHBOURS = 9  # tracks in the next rows, whose median predicts how a track's brightness changed
_MIN_TRACKS = 4 * _NEIGHBOURS
_LEAST_SPREAD = 0.02  # median deviation of the changes: less is within what a window allows for
_EXPLAINED = 0.6  # share of the deviation that the next rows must leave, at the most
_USUAL = 4.0  # times the median of what is left: tracks farther off see something else
_DARK = 8.0  # grey levels, below which ratios tell nothing
_KNOTS = 80  # of the curve over the rows
_PENALTIES = 10.0 ** np.arange(-2, 5)
_LARGEST = 1.0  # of the logarithm


def even_rows(image: np.ndarray) -> np.ndarray:
    """The image (H, W), uint8, with all its rows brought to one mean.

    Whatever the light did to rows is gone, and rows that the scene has moved to carry their means
    with them. What is the same along whole rows is gone, too: good for finding, not for precision.
    """
    means = np.maximum(image.mean(axis=1), 1.0)
    return np.clip(np.rint(image * (110.0 / means[:, None])), 0, 255).astype(np.uint8)


def row_gains(before: Pyramid, after: Pyramid, tracks: Tracks) -> np.ndarray | None:
    """By how much each row (H,) is brighter than before; None where rows have little to do with it.

    Every track tells the ratio of the means around it. If it follows from those in the next rows,
    wherever along the rows they are, much better than from all, it was the rows that changed.
    """
    if len(tracks) < _MIN_TRACKS:
        return None
    grey0, grey1 = _means(before, tracks.points0), _means(after, tracks.points1)
    lit = np.minimum(grey0, grey1) > _DARK
    order = np.argsort(tracks.points1[lit, 1], kind="stable")
    rows = tracks.points1[lit, 1][order]
    changes = np.log(grey1[lit] / grey0[lit])[order]
    if len(rows) < _MIN_TRACKS:
        return None
    changes = changes - np.median(changes)
    spread = np.median(np.abs(changes))
    if spread < _LEAST_SPREAD:
        return None
    half = _NEIGHBOURS // 2
    around = np.lib.stride_tricks.sliding_window_view(changes, _NEIGHBOURS)
    rows, changes = rows[half:-half], changes[half:-half]
    off = np.abs(changes - np.median(np.delete(around, half, axis=1), axis=1))
    left = np.median(off)
    if left > _EXPLAINED * spread:
        return None
    usual = off <= _USUAL * left
    rows, changes = rows[usual], changes[usual]
    height = after.image.shape[0]
    return np.exp(_smoothed(rows, changes, height).clip(-_LARGEST, _LARGEST))


def with_row_gains(image: np.ndarray, gains: np.ndarray) -> np.ndarray:
    """The image (H, W), uint8, with each row's gain (H,) taken back."""
    return np.clip(np.rint(image / gains[:, None]), 0, 255).astype(np.uint8)


def _means(pyramid: Pyramid, points: np.ndarray) -> np.ndarray:
    """Grey values (N,) of a coarse level at points (N, 2) of the finest, interpolated."""
    level = min(_LEVEL, len(pyramid.layout) - 1)
    place, line, width, height = pyramid.layout[level].tolist()
    at = points / 2**level
    whole = np.floor(at).astype(np.int64).clip(0, [width - 1, height - 1])  # a border follows
    across, down = (at - whole).clip(0.0, 1.0).T
    first = place + whole[:, 1] * line + whole[:, 0]
    values = pyramid.values
    above = values[first] * (1.0 - across) + values[first + 1] * across
    below = values[first + line] * (1.0 - across) + values[first + line + 1] * across
    return above * (1.0 - down) + below * down


def _smoothed(rows: np.ndarray, changes: np.ndarray, height: int) -> np.ndarray:
    """The changes at every row (height,): straight lines between knots, whose bends are penalised.

    By how much, generalised cross-validation decides (P. Eilers, B. Marx, "Flexible Smoothing with
    B-splines and Penalties", 1996, doi:10.1214/ss/1038425655).
    """
    knots = np.linspace(rows[0], rows[-1], _KNOTS)
    at = (rows - knots[0]) / (knots[1] - knots[0])
    basis = np.maximum(1.0 - np.abs(at[:, None] - np.arange(_KNOTS)), 0.0)
    bends = np.diff(np.eye(_KNOTS), 2, axis=0)
    normal, penalty, pulls = basis.T @ basis, bends.T @ bends, basis.T @ changes
    best, values = np.inf, np.zeros(_KNOTS)
    for weight in _PENALTIES:
        solved = np.linalg.solve(normal + weight * penalty, np.column_stack([normal, pulls]))
        left = np.sum((changes - basis @ solved[:, -1]) ** 2)
        score = left / (len(rows) - np.trace(solved)) ** 2
        if score < best:
            best, values = score, solved[:, -1]
    return np.interp(np.arange(height), knots, values)
