"""Selection of points that keep a distance from each other."""

from __future__ import annotations

import numpy as np

from farpoint._kernels.compile import inner_kernel, kernel

__all__ = ["cover", "take_places"]


@kernel
def take_places(
    places: np.ndarray, taken: np.ndarray, reach: int, limit: int, kept: np.ndarray
) -> int:
    """Accept places that are not taken, in the given order; returns the number of accepted places.

    Parameters
    ----------
    places : ndarray of int64, shape (N, 2)
        Column and row, within ``taken``.
    taken : ndarray of bool, shape (H, W)
        Pixels that are taken. Every accepted place takes the square of half width ``reach``.
    reach, limit : int
        Half width of the square, px, and largest number of accepted places.
    kept : ndarray of int64, shape (N,)
        Out: indices of the accepted places.
    """
    count = 0
    for index in range(len(places)):
        if count >= limit:
            break
        column, row = places[index, 0], places[index, 1]
        if taken[row, column]:
            continue
        kept[count] = index
        count += 1
        _cover_one(column, row, taken, reach)
    return count


@kernel
def cover(places: np.ndarray, taken: np.ndarray, reach: int) -> None:
    """Mark the square of half width ``reach`` around every place as taken; see `take_places`."""
    for index in range(len(places)):
        _cover_one(places[index, 0], places[index, 1], taken, reach)


@inner_kernel
def _cover_one(column: int, row: int, taken: np.ndarray, reach: int) -> None:
    height, width = taken.shape
    for y in range(max(row - reach, 0), min(row + reach + 1, height)):
        for x in range(max(column - reach, 0), min(column + reach + 1, width)):
            taken[y, x] = True
