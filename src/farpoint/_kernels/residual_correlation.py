"""Correlation of residuals between neighbouring matches."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inlined_kernel, inner_kernel
from farpoint._kernels.constants import GATE_SIGMA, ROUNDING
from farpoint._kernels.pairs import address, ray0, ray1
from farpoint._kernels.vectors import axpby, dot

__all__ = ["bounded", "neighbour_correlation"]


@inner_kernel
def neighbour_correlation(
    pairs: np.ndarray, residual: np.ndarray, rows: np.ndarray, sigma: float, most: int
) -> float:
    """Correlation between the residuals of matches and of their nearest neighbours.

    ``rows`` are the indices of the matches that are used. The correlation is
    ``sum r_i r_nn(i) / sum r_i^2``, where i runs over at most ``most`` of the ``rows``, and r is a
    residual divided by ``sigma`` and clipped to +-`GATE_SIGMA`. The neighbour nn(i) is, among the
    other ``rows``, the match with the least sum of the squared distances to match i in both images;
    it may be another detection of the same point. The expected value is 0 for independent noise.
    The result is also 0 if there is only one match.
    """
    in_order = np.empty(rows.size, np.int64)
    _sort(pairs, rows, in_order)
    queried = rows.size if rows.size < most else most
    product = square = 0.0
    for j in range(queried):
        place = j * rows.size // queried
        here, neighbour = int(in_order[place]), int(_neighbour(pairs, in_order, place))
        if neighbour >= 0:
            own = bounded(residual[here], sigma)
            product += own * bounded(residual[neighbour], sigma)
            square += own * own
    return product / square if square > 0.0 else 0.0


@inner_kernel
def _sort(pairs: np.ndarray, rows: np.ndarray, in_order: np.ndarray) -> None:
    """Sort rows by their first coordinate in image 0: bucket sort, then insertion sort."""
    count = rows.size
    places, ends = np.empty(count), np.empty(count, np.int64)
    low, high = math.inf, -math.inf
    for k in range(count):
        places[k] = ray0(pairs, address(rows[k]))[0]
        low, high = min(low, places[k]), max(high, places[k])
        ends[k] = 0
    over = (count - 1.0) / max(high - low, ROUNDING)
    for k in range(count):
        ends[int((places[k] - low) * over)] += 1
    for s in range(1, count):
        ends[s] += ends[s - 1]
    for k in range(count):
        s = int((places[k] - low) * over)
        ends[s] -= 1
        in_order[ends[s]] = k
    for j in range(1, count):
        k, i = in_order[j], j
        while i > 0 and places[in_order[i - 1]] > places[k]:
            in_order[i] = in_order[i - 1]
            i -= 1
        in_order[i] = k
    for j in range(count):
        in_order[j] = rows[in_order[j]]


@inner_kernel
def _neighbour(pairs: np.ndarray, rows: np.ndarray, place: int) -> int:
    """Row of the nearest other match; -1 if there is no other match."""
    at = address(rows[place])
    nearest, found = math.inf, -1
    for way in (-1, 1):
        k = place + way
        while 0 <= k < rows.size:
            along, distance = _distances2(pairs, at, address(rows[k]))
            if along >= nearest:
                break
            if distance < nearest:
                nearest, found = distance, rows[k]
            k += way
    return found


@inlined_kernel
def _distances2(pairs: np.ndarray, at: int, other: int) -> tuple[float, float]:
    """Two squared distances, rad^2: in the first coordinate of image 0, and over both images."""
    first = axpby(1.0, ray0(pairs, at), -1.0, ray0(pairs, other))
    second = axpby(1.0, ray1(pairs, at), -1.0, ray1(pairs, other))
    return first[0] * first[0], dot(first, first) + dot(second, second)


@inlined_kernel
def bounded(residual: float, sigma: float) -> float:
    """Residual divided by sigma, clipped to +-`GATE_SIGMA`."""
    return min(max(residual / sigma, -GATE_SIGMA), GATE_SIGMA)
