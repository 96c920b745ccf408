"""Detection of evenly spread corners: Shi and Tomasi, "Good Features to Track", CVPR 1994."""

from __future__ import annotations

import numpy as np

from farpoint.tracks.kernels.corners import corner_strength, strongest_places
from farpoint.tracks.kernels.spacing import cover, take_places
from farpoint.tracks.options import CornerOptions

__all__ = ["find_corners", "thin_out"]


def find_corners(
    image: np.ndarray,
    points: np.ndarray,
    count: int,
    border: int,
    options: CornerOptions,
    mask: np.ndarray | None = None,
) -> np.ndarray:
    """Detect new corners, first in the image cells with the fewest tracks.

    Within a cell, stronger corners come first.

    Parameters
    ----------
    image : ndarray of uint8, shape (H, W)
        Grey values.
    points : ndarray, shape (N, 2)
        Pixels of the existing tracks.
    count : int
        Largest number of corners.
    border : int
        Least distance from the border of the image, px.
    options : CornerOptions
        Spacing and strength.
    mask : ndarray of bool, shape (H, W), optional
        True where corners may lie.

    Returns
    -------
    ndarray of float64, shape (M, 2)
        Whole pixels, ``M <= count``.
    """
    empty = np.empty((0, 2))
    if count <= 0 or min(image.shape) <= 2 * border:
        return empty
    occupied = np.zeros(image.shape, bool) if mask is None else ~mask
    cover(np.rint(points).astype(np.int64), occupied, options.min_distance_px - 1)
    candidates, strength = _local_maxima(image, border, occupied, options)
    rank = _rank_in_cell(candidates, strength, points, image.shape, options.cell_px)
    candidates = candidates[np.lexsort((-strength, rank))]
    chosen = thin_out(candidates, occupied, options.min_distance_px - 1, count)
    return candidates[chosen].astype(np.float64)


def thin_out(
    points: np.ndarray, occupied: np.ndarray, reach: int, count: int | None = None
) -> np.ndarray:
    """Indices of the points that keep a distance from each other and from occupied pixels.

    The points are tested in their order. A point is accepted if its pixel is not ``occupied``, bool
    (H, W). Every accepted point marks a square of half width ``reach`` as occupied. The function
    stops after ``count`` accepted points.
    """
    limit = len(points) if count is None else count
    kept = np.empty(len(points), np.int64)
    count = take_places(np.rint(points).astype(np.int64), occupied, reach, limit, kept)
    return kept[:count]


def _local_maxima(
    image: np.ndarray, border: int, occupied: np.ndarray, options: CornerOptions
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (M, 2) and strengths (M,) of local maxima of corner strength that are not occupied."""
    strength = np.empty(image.shape, np.float32)
    corner_strength(np.ascontiguousarray(image), options.block_px, strength)
    reach = max(1, options.min_distance_px // 2)
    rows, columns = (-(-length // (reach + 1)) for length in image.shape)
    peaks = np.empty((rows * columns, 2), np.int64)
    count = strongest_places(strength, options.min_slope**2, reach, border, occupied, peaks)
    peaks = peaks[:count]
    return peaks, strength[peaks[:, 1], peaks[:, 0]]


def _rank_in_cell(
    candidates: np.ndarray,
    strength: np.ndarray,
    points: np.ndarray,
    shape: tuple[int, int],
    cell_px: int,
) -> np.ndarray:
    """For each candidate, the number of points plus stronger candidates in the same cell."""
    columns = -(-shape[1] // cell_px)
    rows = -(-shape[0] // cell_px)

    def cell_of(pixels: np.ndarray) -> np.ndarray:
        column, row = (np.rint(pixels).astype(np.intp) // cell_px).T
        return row * columns + column

    occupancy = np.bincount(cell_of(points), minlength=rows * columns)
    cell = cell_of(candidates)
    order = np.lexsort((-strength, cell))
    first = np.searchsorted(cell[order], cell[order])
    rank = np.empty(len(candidates), np.intp)
    rank[order] = occupancy[cell[order]] + np.arange(len(candidates)) - first
    return rank
