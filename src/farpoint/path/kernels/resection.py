"""Pose of a frame from landmarks."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inner_kernel, loop_kernel, step_kernel
from farpoint._kernels.constants import STUDENT_FREEDOM
from farpoint.path.constants import MIN_FACING_COSINE, WINDOW_RIDGE
from farpoint.path.kernels.geometry import cross, lag, rotated, rotated_back

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


@inner_kernel
def _rotate(R, x, y, z):
    """``R = Exp([x, y, z]) R``."""
    angle = math.sqrt(x * x + y * y + z * z)
    a = math.sin(angle) / angle if angle > 1e-9 else 1.0
    b = (1.0 - math.cos(angle)) / (angle * angle) if angle > 1e-5 else 0.5
    for i in range(3):
        rx, ry, rz = R[0, i], R[1, i], R[2, i]
        cx, cy, cz = cross(x, y, z, rx, ry, rz)
        dx, dy, dz = cross(x, y, z, cx, cy, cz)
        R[0, i], R[1, i], R[2, i] = rx + a * cx + b * dx, ry + a * cy + b * dy, rz + a * cz + b * dz


@inner_kernel
def _solved(H, g, x):
    """Solve ``H x = g`` by Cholesky; returns False if H is not positive definite."""
    n = len(g)
    L = np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1):
            total = H[i, j] * (1.0 + WINDOW_RIDGE) if i == j else H[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                L[i, i] = math.sqrt(total)
            else:
                L[i, j] = total / L[j, j]
    for i in range(n):
        total = g[i]
        for k in range(i):
            total -= L[i, k] * x[k]
        x[i] = total / L[i, i]
    for i in range(n - 1, -1, -1):
        total = x[i]
        for k in range(i + 1, n):
            total -= L[k, i] * x[k]
        x[i] = total / L[i, i]
    return np.isfinite(x).all()


@step_kernel
def _linearise(
    R, p, twist, late, offset, expected, by_ray, X, s, base, before_by_s, J, m, e, E
):  # fmt: skip
    """Residual of a point (2,), derivatives by the pose (2, 6) and by the inverse depth (2,).

    Results: residual ``e``, derivatives ``J`` and ``E``. The other arguments are rows of the
    arguments of `locate`. ``late`` is the time from the middle row to the row of the point, s. The
    buffer ``m`` (2, 3) holds the derivatives by the point. The function returns False for a point
    that is not in front of the camera.
    """
    dx, dy, dz = X[0] - s * p[0], X[1] - s * p[1], X[2] - s * p[2]
    vx, vy, vz = lag(twist, dx, dy, dz, s)
    cx, cy, cz = rotated_back(R, dx - late * vx, dy - late * vy, dz - late * vz)
    depth = expected[0] * cx + expected[1] * cy + expected[2] * cz
    is_seen = depth > MIN_FACING_COSINE * math.sqrt(cx * cx + cy * cy + cz * cz)
    if is_seen:
        inverse = 1.0 / depth
        for q in range(2):
            ux, uy, uz = by_ray[q, 0], by_ray[q, 1], by_ray[q, 2]
            pixel = inverse * (ux * cx + uy * cy + uz * cz)
            m[q, 0], m[q, 1], m[q, 2] = rotated(
                R,
                (ux - pixel * expected[0]) * inverse,
                (uy - pixel * expected[1]) * inverse,
                (uz - pixel * expected[2]) * inverse,
            )
            e[q] = pixel + offset[q]
            E[q] = (
                m[q, 0] * (base[0] - p[0])
                + m[q, 1] * (base[1] - p[1])
                + m[q, 2] * (base[2] - p[2])
                - before_by_s[q]
            )
            tx, ty, tz = cross(m[q, 0], m[q, 1], m[q, 2], dx, dy, dz)
            J[q, 0], J[q, 1], J[q, 2] = tx, ty, tz
            J[q, 3], J[q, 4], J[q, 5] = -s * m[q, 0], -s * m[q, 1], -s * m[q, 2]
    return is_seen


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
    J, m = np.empty((2, 6)), np.empty((2, 3))
    e, E = np.empty(2), np.empty(2)
    g, step, twist = np.empty(6), np.empty(6), np.zeros(6)
    cost, count = 0.0, 0
    for k in range(len(inflations)):
        inflation = inflations[k]
        if seconds > 0.0:
            _velocity(R, R0, p, p0, 1.0 / seconds, twist)
        cost, count = 0.0, 0
        H[:] = 0.0
        g[:] = 0.0
        for o in range(len(s)):
            squares[o] = math.inf
            is_seen = _linearise(
                R, p, twist, row_phase[o] * readout, offsets[o], expected[o], by_ray[o],
                X[o], s[o], base[o], before_by_s[o], J, m, e, E,
            )  # fmt: skip
            if not is_seen:
                continue
            uu = covariances[o, 0] * inflation + s_variance[o] * E[0] * E[0]
            uv = covariances[o, 1] * inflation + s_variance[o] * E[0] * E[1]
            vv = covariances[o, 2] * inflation + s_variance[o] * E[1] * E[1]
            det = uu * vv - uv * uv
            if not det > 0.0:
                continue
            uu, uv, vv = vv / det, -uv / det, uu / det
            square = uu * e[0] * e[0] + 2.0 * uv * e[0] * e[1] + vv * e[1] * e[1]
            squares[o] = square
            weight = (STUDENT_FREEDOM + 2.0) / (STUDENT_FREEDOM + square)
            cost += 0.5 * (STUDENT_FREEDOM + 2.0) * math.log(1.0 + square / STUDENT_FREEDOM)
            count += 1
            for i in range(6):
                w0 = weight * (uu * J[0, i] + uv * J[1, i])
                w1 = weight * (uv * J[0, i] + vv * J[1, i])
                g[i] += w0 * e[0] + w1 * e[1]
                for n in range(6):
                    H[i, n] += w0 * J[0, n] + w1 * J[1, n]
        if not _solved(H, g, step):
            return cost, 0
        _rotate(R, -step[0], -step[1], -step[2])
        for i in range(3):
            p[i] -= step[3 + i]
    return cost, count
