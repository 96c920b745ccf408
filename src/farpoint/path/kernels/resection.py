"""Pose of a frame from landmarks."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.cholesky import factorised, solved
from farpoint._kernels.compile import inner_kernel, loop_kernel, step_kernel
from farpoint._kernels.constants import STUDENT_FREEDOM
from farpoint._kernels.linear import apply_rotation_step
from farpoint._kernels.vectors import axpby, dot, matrix, rotate_back, vector
from farpoint.path.constants import WINDOW_RIDGE
from farpoint.path.kernels.projection import by_point_and_pose, is_facing, lag

__all__ = ["locate"]


@inner_kernel
def _velocity(R, R0, p, p0, rate, twist):
    """``twist`` (6,): rotation vector and displacement from (R0, p0) to (R, p), times ``rate``."""
    D = R @ R0.T
    x, y, z = 0.5 * (D[2, 1] - D[1, 2]), 0.5 * (D[0, 2] - D[2, 0]), 0.5 * (D[1, 0] - D[0, 1])
    sine, cosine = math.sqrt(x * x + y * y + z * z), 0.5 * (D[0, 0] + D[1, 1] + D[2, 2] - 1.0)
    scale = rate * (math.atan2(sine, cosine) / sine if sine > 1e-12 else 1.0)
    twist[0], twist[1], twist[2] = scale * x, scale * y, scale * z
    for i in range(3):
        twist[3 + i] = rate * (p[i] - p0[i])


@step_kernel
def _linearise(
    R, p, twist, late, offset, expected, by_ray, X, s, base, before_by_s, J, e, E
):  # fmt: skip
    """Residual of a point (2,), derivatives by the pose (2, 6) and by the inverse depth (2,).

    Results: residual ``e``, derivatives ``J`` and ``E``. The other arguments are rows of the
    arguments of `locate`. ``late`` is the time from the middle row to the row of the point, s. The
    function returns False for a point that is not in front of the camera.
    """
    away = axpby(1.0, vector(X), -s, vector(p))
    seen = rotate_back(matrix(R), axpby(1.0, away, -late, lag(twist, away, s)))
    if not is_facing(expected, seen):
        return False
    by_depth = axpby(1.0, vector(base), -1.0, vector(p))
    for q in range(2):
        pixel, by_point = by_point_and_pose(R, by_ray[q], expected, seen, away, s, J[q])
        e[q] = pixel + offset[q]
        E[q] = dot(by_point, by_depth) - before_by_s[q]
    return True


@step_kernel
def _add_weighted(covariance, inflation, s_variance, e, E, J, H, g):
    """Add a residual to the normal equations, with Student's robust weight.

    The function returns the squared residual divided by its variance; infinite, and nothing is
    added, if the covariance is not positive definite.
    """
    uu = covariance[0] * inflation + s_variance * E[0] * E[0]
    uv = covariance[1] * inflation + s_variance * E[0] * E[1]
    vv = covariance[2] * inflation + s_variance * E[1] * E[1]
    det = uu * vv - uv * uv
    if not det > 0.0:
        return math.inf
    uu, uv, vv = vv / det, -uv / det, uu / det
    square = uu * e[0] * e[0] + 2.0 * uv * e[0] * e[1] + vv * e[1] * e[1]
    weight = (STUDENT_FREEDOM + 2.0) / (STUDENT_FREEDOM + square)
    for i in range(6):
        w0 = weight * (uu * J[0, i] + uv * J[1, i])
        w1 = weight * (uv * J[0, i] + vv * J[1, i])
        g[i] += w0 * e[0] + w1 * e[1]
        for n in range(6):
            H[i, n] += w0 * J[0, n] + w1 * J[1, n]
    return square


@loop_kernel
def locate(
    R, p, R0, p0, seconds, readout, offsets, row_phase, expected, by_ray, covariances, inflations,
    X, s, s_variance, base, before_by_s, H, squares,
):  # fmt: skip
    """Gauss-Newton steps of the pose of a frame, from N landmarks.

    The pose is perturbed as ``R' = Exp(theta) R``, ``p' = p + rho``.

    Parameters
    ----------
    R, p : (3, 3), (3,)
        The pose, which is updated in place.
    R0, p0, seconds, readout : (3, 3), (3,), float, float
        Pose of the previous frame, time since the previous frame, s, and read-out time, s.
    offsets, row_phase, expected, by_ray : (N, 2), (N,), (N, 3), (N, 2, 3)
        The same quantities as in `pixel_residuals`, but the residual of each point in its last
        keyframe is subtracted from the offset.
    covariances : (N, 3)
        Covariances (uu, uv, vv), px^2, of the change of the residuals since the last keyframe.
    inflations : (I,)
        Factor on the covariances for each step: above 1 if the pose has errors of many sigma.
    X, s, s_variance, base : (N, 3), (N,), (N,), (N, 3)
        Homogeneous points, inverse depths, variances of the inverse depths, and derivatives of X by
        s.
    before_by_s : (N, 2)
        Derivatives of the residuals in the last keyframe by the inverse depths.
    H, squares : (6, 6), (N,)
        Results before the last step: information on the pose, and squared residuals divided by
        their variances. The square is infinite for a point that is not in front of the camera.

    Returns
    -------
    (float, int)
        Robust cost before the last step, and number of points in the cost. The number is 0 if the
        equations of a step were singular.
    """
    J, L, unit = np.empty((2, 6)), np.empty((6, 6)), np.empty(6)
    e, E = np.empty(2), np.empty(2)
    g, step, twist = np.empty(6), np.empty(6), np.zeros(6)
    cost, count = 0.0, 0
    for k in range(len(inflations)):
        if seconds > 0.0:
            _velocity(R, R0, p, p0, 1.0 / seconds, twist)
        cost, count = 0.0, 0
        H[:] = 0.0
        g[:] = 0.0
        for o in range(len(s)):
            squares[o] = math.inf
            if _linearise(
                R, p, twist, row_phase[o] * readout, offsets[o], expected[o], by_ray[o],
                X[o], s[o], base[o], before_by_s[o], J, e, E,
            ):  # fmt: skip
                squares[o] = _add_weighted(
                    covariances[o], inflations[k], s_variance[o], e, E, J, H, g
                )
            if squares[o] < math.inf:
                square = squares[o] / STUDENT_FREEDOM
                cost += 0.5 * (STUDENT_FREEDOM + 2.0) * math.log(1.0 + square)
                count += 1
        if not factorised(H, WINDOW_RIDGE, unit, L):
            return cost, 0
        solved(L, unit, g, step)
        apply_rotation_step(R, -step[0], -step[1], -step[2], R)
        for i in range(3):
            p[i] -= step[3 + i]
    return cost, count
