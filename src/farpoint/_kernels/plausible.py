"""Where along its epipolar line a right match may lie, learnt from the others."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inner_kernel, kernel
from farpoint._kernels.formulas import greater, lesser
from farpoint._kernels.scratch import room

__all__ = ["FADE", "LEAST_TAIL", "NONE", "largest", "plausible_parallax"]

# Half-width of the band in which a match agrees with its epipolar line, in sigma.
BAND_SIGMA = 3.0
# Wrong matches that a direction may have been drawn through; and how many times as many as by
# chance may lie on their lines besides.
CHOSEN = 3
MANIFOLD = 4.0
# How far beyond the last match that others vouch for one may lie at least, of the way to that one,
# and in what share of that distance it fades out.
LEAST_TAIL = 0.1
FADE = 0.3
# How often it fades until nothing is left.
NONE = 3.0


@inner_kernel
def largest(values: np.ndarray, k: int) -> float:
    """The ``k``-th largest of non-negative values, to a millionth of the largest."""
    low, high = 0.0, 0.0
    for i in range(values.size):
        high = greater(high, values[i])
    least = 1e-6 * high
    while high - low > least:
        middle = 0.5 * (low + high)
        above = 0
        for i in range(values.size):
            above += 1 if values[i] > middle else 0
        if above >= k:
            low = middle
        else:
            high = middle
    return high


@kernel
def plausible_parallax(
    parallax: np.ndarray,
    right: np.ndarray,
    count: int,
    sigma: float,
    spread: float,
    prior: np.ndarray,
) -> float:
    """Prior of each match from where it lies along its epipolar line; the parallax that ends it.

    A wrong match lies anywhere in the image; a right one not far beyond the others. Up to there the
    prior is flat: it scales the density of right matches from the strip ``2 spread`` to the length
    of the flat part.

    A wrong match far along the line outweighs all right ones. `MANIFOLD` times as many as can be
    expected to lie in the band by chance, and `CHOSEN` that the direction may have been drawn
    through, may not vouch for one another. How far beyond the last of the others one may lie, up to
    twice as far, tells by how much they have thinned out there, from the last but as many: they may
    end at once.

    Who is ``right`` is asked without a prior: of those that are left when some were implausible, as
    many again would not vouch for one another.
    """
    sizes = room(count)
    bulk = 0
    for i in range(count):
        p = parallax[i] / sigma
        belongs = right[i] > 0.5 and p > -BAND_SIGMA
        sizes[i] = abs(p) if belongs else -1.0
        bulk += 1 if belongs else 0
    wrong = count - bulk
    # Where no match is off the lines, none is on one by chance.
    by_chance = wrong * BAND_SIGMA * sigma / spread
    captured = lesser(wrong, CHOSEN + math.floor(MANIFOLD * by_chance + 0.5))
    if bulk <= captured:
        for i in range(count):
            prior[i] = 1.0
        return math.inf
    last = greater(largest(sizes, captured + 1), BAND_SIGMA)
    nearer = greater(largest(sizes, 2 * (captured + 1)) / last, math.sqrt(0.5))
    tail = greater(greater(1.0 / (nearer * nearer) - 1.0, LEAST_TAIL) * last, BAND_SIGMA)
    flat = greater(2.0 * spread / ((last + tail + BAND_SIGMA) * sigma), 1.0)
    for i in range(count):
        beyond = (parallax[i] / sigma - last) / tail
        prior[i] = flat * math.exp(-0.5 * (greater(beyond - 1.0, 0.0) / FADE) ** 2)
    return (last + (1.0 + NONE * FADE) * tail) * sigma
