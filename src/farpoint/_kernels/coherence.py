"""Whether matches that lie side by side are off alike, as noise is not."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inner_kernel, kernel
from farpoint._kernels.formulas import formula, greater, lesser
from farpoint._kernels.pairs import address, flow_variance, ray0, ray1
from farpoint._kernels.vectors import combine, dot

__all__ = ["bounded", "coherence"]

# No residual counts for more, in sigma.
MOST_SIGMA = 3.0


@kernel
def coherence(
    pairs: np.ndarray,
    residual: np.ndarray,
    rows: np.ndarray,
    sigma: float,
    most: int,
    same_point: float,
) -> tuple[float, float]:
    """Correlation of the residuals of matches with those of their neighbours, of whatever point.

    And with those of another point: not nearer than ``same_point``, in units of the noise. The
    neighbour is that of these ``rows`` which is nearest in both images together; they are in the
    order of their first coordinate in image 0. At ``most`` so many are asked for theirs. 0 on
    average where residuals are noise; 0 as well where there are hardly any.
    """
    asked = rows.size if rows.size < most else most
    product = square = other_product = other_square = 0.0
    for j in range(asked):
        place = j * rows.size // asked
        neighbour, other = _neighbours(pairs, rows, place, same_point)
        own = bounded(residual[int(rows[place])], sigma)
        if neighbour >= 0:
            product += own * bounded(residual[int(neighbour)], sigma)
            square += own * own
        if other >= 0:
            other_product += own * bounded(residual[int(other)], sigma)
            other_square += own * own
    return (
        product / square if square > 0.0 else 0.0,
        other_product / other_square if other_square > 0.0 else 0.0,
    )


@inner_kernel
def _neighbours(
    pairs: np.ndarray, rows: np.ndarray, place: int, same_point: float
) -> tuple[int, int]:
    """The row nearest to that at this place, and the nearest of another point; -1 for none."""
    at = address(rows[place])
    same = same_point * same_point * flow_variance(pairs, at)
    nearest, found = math.inf, -1
    nearest_other, other = math.inf, -1
    for way in (-1, 1):
        k = place + way
        while 0 <= k < rows.size:
            along, distance = _distances2(pairs, at, address(rows[k]))
            if along >= nearest_other:
                break
            if distance < nearest:
                nearest, found = distance, rows[k]
            if same <= distance < nearest_other:
                nearest_other, other = distance, rows[k]
            k += way
    return found, other


@formula
def _distances2(pairs: np.ndarray, at: int, other: int) -> tuple[float, float]:
    """Of two matches, rad^2: by the first coordinate in image 0, and in both images together."""
    first = combine(1.0, ray0(pairs, at), -1.0, ray0(pairs, other))
    second = combine(1.0, ray1(pairs, at), -1.0, ray1(pairs, other))
    return first[0] * first[0], dot(first, first) + dot(second, second)


@formula
def bounded(residual: float, sigma: float) -> float:
    """A residual in units of its sigma, as far as it counts."""
    return lesser(greater(residual / sigma, -MOST_SIGMA), MOST_SIGMA)
