"""Motions nearly as likely as a given motion: planar ambiguity and bas-relief ambiguity."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.arrays import clear
from farpoint._kernels.compile import inner_kernel, step_kernel
from farpoint._kernels.epipolar import flow_along, sampson
from farpoint._kernels.linear import add, add_outer, apply_quaternion, kabsch, put
from farpoint._kernels.normal_equations import solve_three_spd
from farpoint._kernels.pairs import address, ray0, ray1
from farpoint._kernels.parallax_prior import kth_largest
from farpoint._kernels.vectors import (
    Matrix,
    Vector,
    axpby,
    cross,
    dot,
    matrix,
    norm,
    rotate,
    rotate_back,
    vector,
)

__all__ = ["bas_relief_motion", "second_planar_motion"]


@inner_kernel
def second_planar_motion(
    pairs: np.ndarray,
    count: int,
    gate: float,
    R: np.ndarray,
    t: np.ndarray,
    other_R: np.ndarray,
    other_t: np.ndarray,
) -> bool:
    """Second motion with the same homography of a plane; False if the matches fix no plane.

    The plane is ``n . X = 1`` in the axes of camera 0. The unit of length is the length of the
    translation, so ``n . a`` is the inverse depth of the plane along a ray a. n is fitted to the
    inverse depths of the matches under the motion ``R, t``. With ``tau = R^T t`` the homography of
    the plane is ``R (I + tau n^T)``. The second motion, with a second plane, has the same
    homography. Its rotation ``other_R`` is R times the rotation of the quaternion
    ``(2 + n . tau, n x tau)`` (scalar first, not normalised), its direction ``other_t`` is along
    ``R (2 n + (n . n) tau)``, and the normal of the second plane is along ``n + 2 tau`` (relations
    of Malis and Vargas, INRIA RR-6303, 2007). If the translation is short compared with the
    distance of the plane, the second translation is along the first normal, and the second normal
    along the first translation (Longuet-Higgins, Proc. R. Soc. B 223, 1984, DOI
    10.1098/rspb.1984.0088).

    If the second plane is behind the camera for most matches, ``other_t`` is reversed. Matches with
    an absolute Sampson residual above ``gate`` are left out. The function also returns False for a
    plane at infinity.
    """
    inverse, accuracy, n = np.empty(count), np.empty(count), np.empty(3)
    direction = vector(t)
    tau = rotate_back(matrix(R), direction)
    _inverse_distances(pairs, gate, matrix(R), direction, inverse, accuracy)
    if not _fit_plane(pairs, inverse, accuracy, n):
        return False
    plane = vector(n)
    square = dot(plane, plane)
    if not square > 1e-18:
        return False
    # ``apply_quaternion`` multiplies R on the left: ``R Exp(a) = Exp(R a) R``.
    w, (x, y, z) = 2.0 + dot(plane, tau), rotate(matrix(R), cross(plane, tau))
    over = 1.0 / math.sqrt(w * w + x * x + y * y + z * z + 1e-300)
    apply_quaternion(over * w, over * x, over * y, over * z, R, other_R)
    ahead = _ahead_of(pairs, accuracy, axpby(1.0, plane, 2.0, tau))
    way = rotate(matrix(R), axpby(2.0, plane, square, tau))
    put(math.copysign(1.0, ahead) / (norm(way) + 1e-300), way, other_t)
    return True


@step_kernel
def _ahead_of(pairs: np.ndarray, accuracy: np.ndarray, normal: Vector) -> int:
    """Number of matches with ``normal . a > 0`` minus number of other matches.

    a is the ray in camera 0. Matches with ``accuracy`` 0 are not counted.
    """
    ahead = 0
    for i in range(accuracy.size):
        along = dot(normal, ray0(pairs, address(i)))
        ahead += (1 if along > 0.0 else -1) if accuracy[i] > 0.0 else 0
    return ahead


@step_kernel
def _inverse_distances(
    pairs: np.ndarray,
    gate: float,
    R: Matrix,
    t: Vector,
    inverse: np.ndarray,
    accuracy: np.ndarray,
) -> None:
    """Write the inverse depth of each match, and the information on the inverse depth.

    The information, ``accuracy``, is the squared sine of the angle between the ray in camera 1 and
    the epipole, up to a factor that is the same for all matches. It is 0 for a match at the epipole
    or with an absolute Sampson residual above ``gate``.
    """
    tau = rotate_back(R, t)
    for i in range(inverse.size):
        at = address(i)
        a = ray0(pairs, at)
        inverse[i], square = _inverse_distance(a, rotate_back(R, ray1(pairs, at)), tau)
        agrees = abs(sampson(pairs, at, R, t)) <= gate and square > 1e-12
        accuracy[i] = square if agrees else 0.0


@step_kernel
def _inverse_distance(a: Vector, back: Vector, tau: Vector) -> tuple[float, float]:
    """Inverse depth of a match, and the squared sine of the angle between ray and epipole."""
    # back is parallel to l0 a + tau, where l0 is the depth: a x back = (back x tau) / l0.
    across = cross(back, tau)
    square = dot(across, across)
    return dot(cross(a, back), across) / square, square


@step_kernel
def _fit_plane(pairs: np.ndarray, inverse: np.ndarray, accuracy: np.ndarray, n: np.ndarray) -> bool:
    """Robust weighted fit of ``n . a`` to the inverse depths; False without a unique plane.

    The weights are smaller for inverse depths above the median, because a plane could otherwise fit
    one or two outliers with a large inverse depth exactly.
    """
    sizes, consistent = np.empty(inverse.size), 0
    for i in range(inverse.size):
        sizes[i] = abs(inverse[i]) if accuracy[i] > 0.0 else -1.0
        consistent += 1 if accuracy[i] > 0.0 else 0
    typical = kth_largest(sizes, (consistent + 1) // 2)
    M, v = np.empty((3, 3)), np.empty(3)
    clear(M)
    clear(v)
    for i in range(inverse.size):
        if accuracy[i] > 0.0:
            a = ray0(pairs, address(i))
            weight = accuracy[i] / (typical * typical + inverse[i] * inverse[i] + 1e-300)
            add_outer(a, a, weight, M)
            add(weight * inverse[i], a, v)
    return solve_three_spd(M, v, 1e-9, n)


@inner_kernel
def bas_relief_motion(
    pairs: np.ndarray,
    count: int,
    gate: float,
    R: np.ndarray,
    t: np.ndarray,
    other_R: np.ndarray,
    other_t: np.ndarray,
) -> bool:
    """Bas-relief alternative of a motion; False if the near points fix no rotation.

    In a narrow field of view, a translation across the mean ray and a rotation cause nearly the
    same flow of points at one depth. In the alternative motion, the rotation ``other_R`` alone
    causes the flow of the near points. This rotation moves far points by the same flow, so the
    remaining flow of far points is opposite to the flow that the translation ``t`` causes. The
    component of the direction across the mean ray is therefore reversed in ``other_t``. The
    component along the mean ray is kept, because no rotation causes the flow of a translation along
    the mean ray. Points nearer than the median depth are near points. The mean ray is that of
    camera 1. Matches with an absolute Sampson residual above ``gate`` are left out.
    """
    M, nearness, ahead = np.empty((3, 3)), np.empty(count), np.empty(3)
    clear(M)
    clear(ahead)
    direction, consistent = vector(t), 0
    for i in range(count):
        at = address(i)
        m, b = rotate(matrix(R), ray0(pairs, at)), ray1(pairs, at)
        flow, reach2 = flow_along(m, b, direction)
        agrees = abs(sampson(pairs, at, matrix(R), direction)) <= gate
        # Inverse depth, bounded at the epipole.
        nearness[i] = max(flow, 0.0) / max(reach2, 1e-6) if agrees else -1.0
        consistent += 1 if agrees else 0
        if agrees:
            add(1.0, b, ahead)
    typical = kth_largest(nearness, consistent // 2)
    for i in range(count):
        if nearness[i] > typical:
            add_outer(ray1(pairs, address(i)), ray0(pairs, address(i)), 1.0, M)
    axis = vector(ahead)
    along = 2.0 * dot(axis, direction) / (dot(axis, axis) + 1e-300)
    put(1.0, axpby(along, axis, -1.0, direction), other_t)
    return kabsch(M, other_R)
