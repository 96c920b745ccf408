"""Corners to track: Shi and Tomasi, "Good Features to Track", CVPR 1994, spread over the image."""

from __future__ import annotations

import numpy as np

from farpoint._kernels.spacing import take_places
from farpoint.errors import optional_import
from farpoint.tracks.options import CornerOptions

__all__ = ["find_corners", "thin_out"]

# cv2.cornerMinEigenVal scales slopes of 8-bit images by 2 / 255 with its 3x3 Sobel kernel.
_SLOPE_PER_ROOT = 255.0 / 2.0
_STRIP = 64  # rows


def find_corners(
    image: np.ndarray,
    points: np.ndarray,
    count: int,
    border: int,
    options: CornerOptions,
    mask: np.ndarray | None = None,
) -> np.ndarray:
    """New corners where tracks are missing.

    The image is divided into cells. Every new corner goes to the cell that holds the fewest points
    among those that still offer one, the strongest corner of a cell first.

    Parameters
    ----------
    image : ndarray of uint8, shape (H, W)
        Grey values.
    points : ndarray, shape (N, 2)
        Pixels of the tracks that are there already.
    count : int
        Number of corners wanted; fewer are returned where the image has no more.
    border : int
        Distance to keep from the border of the image, px.
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
    candidates, strength = _local_maxima(image, border, options, mask)
    taken = _surroundings(points, image.shape, options.min_distance_px - 1)
    free = ~taken[candidates[:, 1], candidates[:, 0]]
    candidates, strength = candidates[free], strength[free]
    rank = _rank_in_cell(candidates, strength, points, image.shape, options.cell_px)
    candidates = candidates[np.lexsort((-strength, rank))]
    chosen = thin_out(candidates, taken, options.min_distance_px - 1, count)
    return candidates[chosen].astype(np.float64)


def thin_out(
    points: np.ndarray, taken: np.ndarray, reach: int, count: int | None = None
) -> np.ndarray:
    """Indices of the points that do not lie in places taken, in their order.

    Every point accepted takes the pixels within ``reach`` along either axis; ``taken`` (H, W), of
    bool, is updated. Stops after ``count`` points.
    """
    limit = len(points) if count is None else count
    kept = np.empty(len(points), np.int64)
    count = take_places(np.rint(points).astype(np.int64), taken, reach, limit, kept)
    return kept[:count]


def _surroundings(points: np.ndarray, shape: tuple[int, int], reach: int) -> np.ndarray:
    """Mask (H, W) of the pixels within ``reach`` of a point along either axis."""
    cv2 = optional_import("cv2", extra="video", purpose="tracking")
    mask = np.zeros(shape, np.uint8)
    x, y = np.rint(points).astype(np.intp).T
    mask[y, x] = 1
    return cv2.dilate(mask, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)).astype(bool)


def _local_maxima(
    image: np.ndarray, border: int, options: CornerOptions, mask: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (M, 2) and strengths (M,) of the corners that outdo their neighbours."""
    cv2 = optional_import("cv2", extra="video", purpose="tracking")
    strength = _corner_strength(image, options.block_px)
    reach = max(1, options.min_distance_px // 2)
    neighbourhood = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    peak = strength == cv2.dilate(strength, neighbourhood)
    peak &= strength > (options.min_slope / _SLOPE_PER_ROOT) ** 2
    if mask is not None:
        peak &= mask
    height, width = image.shape
    inner = np.ascontiguousarray(peak[border : height - border, border : width - border])
    found = cv2.findNonZero(inner.view(np.uint8))  # three times as fast as np.nonzero
    if found is None:
        return np.empty((0, 2), np.intp), np.empty(0)
    x, y = found.reshape(-1, 2).T.astype(np.intp) + border
    return np.stack([x, y], axis=1), strength[y, x]


def _corner_strength(image: np.ndarray, block_px: int) -> np.ndarray:
    """Smallest eigenvalue of the gradients' second moments, float32, shape (H, W).

    In strips, since OpenCV's buffers for a whole image fall out of the cache: three times as fast.
    """
    cv2 = optional_import("cv2", extra="video", purpose="tracking")
    height = len(image)
    strength = np.empty(image.shape, np.float32)
    halo = block_px + 1
    for top in range(0, height, _STRIP):
        above, below = min(halo, top), min(height, top + _STRIP + halo)
        strip = cv2.cornerMinEigenVal(image[top - above : below], block_px, ksize=3)
        strength[top : top + _STRIP] = strip[above : above + _STRIP]
    return strength


def _rank_in_cell(
    candidates: np.ndarray,
    strength: np.ndarray,
    points: np.ndarray,
    shape: tuple[int, int],
    cell_px: int,
) -> np.ndarray:
    """Number of points each candidate's cell holds if its stronger candidates are taken first."""
    columns = -(-shape[1] // cell_px)
    rows = -(-shape[0] // cell_px)

    def cell_of(pixels: np.ndarray) -> np.ndarray:
        column, row = (np.rint(pixels).astype(np.intp) // cell_px).T
        return row * columns + column

    held = np.bincount(cell_of(points), minlength=rows * columns)
    cell = cell_of(candidates)
    order = np.lexsort((-strength, cell))
    first = np.searchsorted(cell[order], cell[order])
    rank = np.empty(len(candidates), np.intp)
    rank[order] = held[cell[order]] + np.arange(len(candidates)) - first
    return rank
