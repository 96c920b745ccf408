"""Direction of translation when the rotation is known: intersections of great circles.

A match, its first ray turned by the rotation, moves along the great circle through both rays; all
these circles meet at the direction of translation. On the sphere the intersection of two circles is
the cross product of their normals, wherever it lies: in the image, at 90 degrees or behind.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import kernel
from farpoint._kernels.pairs import RayPairs

__all__ = ["intersect_circles", "pairwise_direction"]


@kernel
def circle(
    pairs: RayPairs,
    R: np.ndarray,
    i: int,
    normal: np.ndarray,
    flow: np.ndarray,
) -> None:
    """Normal ``m x b`` (not normalised) and flow ``b - m`` of match ``i`` with ``m = R a``."""
    a0, a1, a2 = pairs.rays0[i, 0], pairs.rays0[i, 1], pairs.rays0[i, 2]
    b0, b1, b2 = pairs.rays1[i, 0], pairs.rays1[i, 1], pairs.rays1[i, 2]
    m0 = R[0, 0] * a0 + R[0, 1] * a1 + R[0, 2] * a2
    m1 = R[1, 0] * a0 + R[1, 1] * a1 + R[1, 2] * a2
    m2 = R[2, 0] * a0 + R[2, 1] * a1 + R[2, 2] * a2
    flow[0], flow[1], flow[2] = b0 - m0, b1 - m1, b2 - m2
    # m x (b - m) loses no digits where the flow is short.
    normal[0] = m1 * flow[2] - m2 * flow[1]
    normal[1] = m2 * flow[0] - m0 * flow[2]
    normal[2] = m0 * flow[1] - m1 * flow[0]


@kernel
def intersect_circles(pairs: RayPairs, R: np.ndarray, i: int, j: int, t: np.ndarray) -> bool:
    """Direction ``t`` (3,) from matches ``i`` and ``j``, signed so that both flow towards it."""
    n = np.empty((2, 3))
    f = np.empty((2, 3))
    circle(pairs, R, i, n[0], f[0])
    circle(pairs, R, j, n[1], f[1])
    t[0] = n[0, 1] * n[1, 2] - n[0, 2] * n[1, 1]
    t[1] = n[0, 2] * n[1, 0] - n[0, 0] * n[1, 2]
    t[2] = n[0, 0] * n[1, 1] - n[0, 1] * n[1, 0]
    norm = math.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2])
    if not norm > 1e-30:
        return False
    along = 0.0
    for k in range(3):
        along += t[k] * (f[0, k] + f[1, k])
    if along < 0.0:
        norm = -norm
    for k in range(3):
        t[k] /= norm
    return True


@kernel
def pairwise_direction(
    pairs: RayPairs,
    weight: np.ndarray,
    R: np.ndarray,
    partial: np.ndarray,
) -> None:
    """Weighted sum of all pairwise intersections (eqs. 14-17), kept apart by match.

    ``partial[i]`` (N, 3) receives ``sum_j w_i w_j c_ij (n_i x n_j)`` with unit normals, so that a
    pair counts by the sine of the angle at which its circles cross, and the sign c = +-1 that lets
    both matches flow towards the intersection. Each pair stands in two rows, so
    the sum over all rows is twice the sum over pairs; leaving a match out takes off its row once.
    """
    n = pairs.rays0.shape[0]
    normal = np.empty((n, 3))
    flow = np.empty((n, 3))
    for i in range(n):
        circle(pairs, R, i, normal[i], flow[i])
        length = math.sqrt(normal[i, 0] ** 2 + normal[i, 1] ** 2 + normal[i, 2] ** 2)
        if length > 0.0:
            for k in range(3):
                normal[i, k] /= length
                flow[i, k] /= length
    partial[:, :] = 0.0
    for i in range(n):
        if weight[i] == 0.0:
            continue
        for j in range(i):
            if weight[j] == 0.0:
                continue
            x = normal[i, 1] * normal[j, 2] - normal[i, 2] * normal[j, 1]
            y = normal[i, 2] * normal[j, 0] - normal[i, 0] * normal[j, 2]
            z = normal[i, 0] * normal[j, 1] - normal[i, 1] * normal[j, 0]
            along = (
                x * (flow[i, 0] + flow[j, 0])
                + y * (flow[i, 1] + flow[j, 1])
                + z * (flow[i, 2] + flow[j, 2])
            )
            scale = math.copysign(weight[i] * weight[j], along)
            partial[i, 0] += scale * x
            partial[i, 1] += scale * y
            partial[i, 2] += scale * z
            partial[j, 0] += scale * x
            partial[j, 1] += scale * y
            partial[j, 2] += scale * z
