"""Correlation of residuals between neighbouring matches."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inlined_kernel, inner_kernel, kernel
from farpoint._kernels.pairs import address, ray0, ray1
from farpoint._kernels.vectors import axpby, dot

__all__ = ["neighbour_correlation"]


@kernel
def neighbour_correlation(
    pairs: np.ndarray, rows: np.ndarray, residual: np.ndarray, most: int
) -> float:
    """Correlation between the residuals of matches and of their nearest neighbours.

    ``rows`` (K,) are the indices of the matches that are used, sorted by the first coordinate of
    the rays in image 0, and ``residual`` (K,) are the residuals of these matches. The correlation
    is ``sum r_i r_nn(i) / sum r_i^2``, where i runs over at most ``most`` of the ``rows``. The
    neighbour nn(i) is, among the other ``rows``, the match with the least sum of the squared
    distances to match i in both images; it may be another detection of the same point. The expected
    value is 0 for independent noise. The result is also 0 if there is only one match.
    """
    queried = rows.size if rows.size < most else most
    product = square = 0.0
    for j in range(queried):
        place = j * rows.size // queried
        neighbour = int(_neighbour(pairs, rows, place))
        if neighbour >= 0:
            product += residual[place] * residual[neighbour]
            square += residual[place] * residual[place]
    return product / square if square > 0.0 else 0.0


@inner_kernel
def _neighbour(pairs: np.ndarray, rows: np.ndarray, place: int) -> int:
    """Place, in ``rows``, of the nearest other match; -1 if there is no other match."""
    at = address(rows[place])
    nearest, found = math.inf, -1
    for way in (-1, 1):
        k = place + way
        while 0 <= k < rows.size:
            along, distance = _distances2(pairs, at, address(rows[k]))
            if along >= nearest:
                break
            if distance < nearest:
                nearest, found = distance, k
            k += way
    return found


@inlined_kernel
def _distances2(pairs: np.ndarray, at: int, other: int) -> tuple[float, float]:
    """Two squared distances, rad^2: in the first coordinate of image 0, and over both images."""
    first = axpby(1.0, ray0(pairs, at), -1.0, ray0(pairs, other))
    second = axpby(1.0, ray1(pairs, at), -1.0, ray1(pairs, other))
    return first[0] * first[0], dot(first, first) + dot(second, second)
