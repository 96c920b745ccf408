"""Whether wrong matches lie about their epipolar lines, as those of repeated structure do."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inner_kernel, kernel
from farpoint._kernels.formulas import formula
from farpoint._kernels.pairs import address, flow_variance, ray0, ray1
from farpoint._kernels.scratch import index_room
from farpoint._kernels.vectors import cross, dot, matrix, rotate, vector

__all__ = ["beyond_chance"]

# Others that each wrong match is paired with, to see what chance does.
OTHERS = 8
# Sigma of what chance does that are no structure.
SURE = 3.0


@kernel
def beyond_chance(
    pairs: np.ndarray, right: np.ndarray, R: np.ndarray, t: np.ndarray, within: float
) -> float:
    """How many wrong matches lie about their epipolar lines for a reason, at least.

    Those ``within`` so many units of the noise, less as many as there would be if each ray in
    camera 0 had that of another wrong match in camera 1. Where the rays of an image end up tells
    that, not its size: an image is wide, or the lines meet in the middle of it.

    ``right`` (N,) is the chance of each match to be right.
    """
    wrong = index_room(right.size)
    count = 0
    for i in range(right.size):
        if right[i] < 0.5:
            wrong[count] = i
            count += 1
    own = _within(pairs, wrong, count, 0, R, t, within)
    chance = 0.0
    for k in range(1, OTHERS + 1):
        chance += _within(pairs, wrong, count, k * count // (OTHERS + 1), R, t, within) / OTHERS
    return own - chance - SURE * math.sqrt(chance)


@inner_kernel
def _within(
    pairs: np.ndarray,
    wrong: np.ndarray,
    count: int,
    shift: int,
    R: np.ndarray,
    t: np.ndarray,
    within: float,
) -> int:
    """How many rays in camera 1 lie so near the line of the ray that is ``shift`` places before."""
    found = 0
    for k in range(count):
        first, second = address(wrong[k]), address(wrong[(k + shift) % count])
        found += 1 if _off2(pairs, first, second, R, t) < within * within else 0
    return found


@formula
def _off2(pairs: np.ndarray, first: int, second: int, R: np.ndarray, t: np.ndarray) -> float:
    """Squared residual of two rays, as of noise that is the same in all directions."""
    m, b, towards = rotate(matrix(R), ray0(pairs, first)), ray1(pairs, second), vector(t)
    n, q = cross(towards, m), cross(b, towards)
    e = dot(b, n)
    variance = 0.25 * (flow_variance(pairs, first) + flow_variance(pairs, second))
    return e * e / (variance * (dot(n, n) + dot(q, q)) + 1e-300)
