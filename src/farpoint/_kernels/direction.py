"""Direction of translation at a known rotation: intersections of great circles.

After the rotation is removed from the flow, a match moves along the great circle through its two
rays. The great circles of all matches intersect at the direction of translation. The intersection
of two circles is the cross product of their normals. The intersection may lie in the image, at 90
degrees from the optical axis, or behind the camera.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.arrays import clear
from farpoint._kernels.compile import inlined_kernel, inner_kernel, kernel
from farpoint._kernels.linear import add, put
from farpoint._kernels.pairs import address, ray0, ray1
from farpoint._kernels.vectors import (
    Matrix,
    Vector,
    axpby,
    cross,
    dot,
    matrix,
    norm,
    rotate,
    vector,
)

__all__ = ["intersect_circles", "pairwise_direction"]


@inlined_kernel
def circle(pairs: np.ndarray, R: Matrix, i: int) -> tuple[Vector, Vector]:
    """Great circle of match ``i``: normal ``m x b``, not normalised, and flow ``b - m``.

    ``m`` is ``R a``.
    """
    at = address(i)
    m = rotate(R, ray0(pairs, at))
    flow = axpby(1.0, ray1(pairs, at), -1.0, m)
    # m x (b - m) equals m x b, and is more exact for a short flow.
    return cross(m, flow), flow


@inner_kernel
def intersect_circles(pairs: np.ndarray, R: np.ndarray, i: int, j: int, t: np.ndarray) -> bool:
    """Intersection ``t`` (3,) of the great circles of two matches; False if the circles coincide.

    Of the two opposite intersections, ``t`` is the one towards which the sum of both flows points.
    """
    rotation = matrix(R)
    normal0, flow0 = circle(pairs, rotation, i)
    normal1, flow1 = circle(pairs, rotation, j)
    meeting = cross(normal0, normal1)
    length = norm(meeting)
    if not length > 1e-30:
        return False
    sign = math.copysign(1.0 / length, dot(meeting, flow0) + dot(meeting, flow1))
    put(sign, meeting, t)
    return True


@kernel
def pairwise_direction(
    pairs: np.ndarray,
    weight: np.ndarray,
    R: np.ndarray,
    partial: np.ndarray,
) -> None:
    """Weighted sum of all pairwise intersections, by match (Burschka and Mair 2008, eqs. 14-17).

    ``partial[i]`` (N, 3) receives ``sum_j w_i w_j c_ij (n_i x n_j)`` with unit normals n. The
    length of the cross product is the sine of the angle between the two circles, and so is part of
    the weight of the pair. The sign c = +-1 is such that the sum of both flows, as unit vectors,
    points towards the intersection. Each pair is in two rows, so the sum over all rows is twice the
    sum over all pairs. To leave out a match, subtract the row of the match from the sum over all
    pairs.
    """
    n = weight.size
    rotation = matrix(R)
    normals = np.empty((n, 3))
    flows = np.empty((n, 3))
    for i in range(n):
        normal, flow = circle(pairs, rotation, i)
        length = max(norm(normal), 1e-300)
        put(1.0 / length, normal, normals[i])
        put(1.0 / length, flow, flows[i])
    clear(partial)
    for i in range(n):
        if weight[i] == 0.0:
            continue
        for j in range(i):
            if weight[j] == 0.0:
                continue
            meeting = cross(vector(normals[i]), vector(normals[j]))
            along = dot(meeting, vector(flows[i])) + dot(meeting, vector(flows[j]))
            scale = math.copysign(weight[i] * weight[j], along)
            add(scale, meeting, partial[i])
            add(scale, meeting, partial[j])
