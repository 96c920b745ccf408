"""Sums over the observations of a window: information on poses, lens, shutter and points.

A point has the ray ``b`` in its anchor, keyframe a, and the inverse depth ``s``. In world axes and
up to scale, the point is ``X = R_a b + s p_a``. Keyframe k observes the point along ``R_k^T (X - s
p_k)``. The projection of this ray is compared with the observed pixel. Poses are perturbed in world
axes as ``R' = Exp(theta) R``, ``p' = Exp(theta) p + rho``. With this perturbation, the derivative
by the anchor's pose is minus the derivative by the observer's pose. Rolling shutter: a camera that
rotates by ``w`` and moves by ``v`` per second observes the point at ``X - t (w x (X - s p) + s v)``
in a row that is read the time t after the middle row.

The functions take arrays and write into arrays of the caller.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inner_kernel, loop_kernel, step_kernel
from farpoint._kernels.constants import STUDENT_FREEDOM
from farpoint.path.constants import MIN_FACING_COSINE, UNSEEN_COST, UNSEEN_PX, WINDOW_RIDGE

__all__ = [
    "by_sigmas",
    "expected_rays",
    "gather_information",
    "locate",
    "pixel_residuals",
    "point_steps",
    "robust_cost",
]


@step_kernel
def _rotated(R, x, y, z):
    """``R @ [x, y, z]``."""
    return (
        R[0, 0] * x + R[0, 1] * y + R[0, 2] * z,
        R[1, 0] * x + R[1, 1] * y + R[1, 2] * z,
        R[2, 0] * x + R[2, 1] * y + R[2, 2] * z,
    )


@step_kernel
def _rotated_back(R, x, y, z):
    """``R.T @ [x, y, z]``."""
    return (
        R[0, 0] * x + R[1, 0] * y + R[2, 0] * z,
        R[0, 1] * x + R[1, 1] * y + R[2, 1] * z,
        R[0, 2] * x + R[1, 2] * y + R[2, 2] * z,
    )


@step_kernel
def _cross(ax, ay, az, bx, by, bz):
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@step_kernel
def _lag(twist, x, y, z, s):
    """``w x d + s v``: change per second of a homogeneous point at ``d`` from the camera."""
    cx, cy, cz = _cross(twist[0], twist[1], twist[2], x, y, z)
    return cx + s * twist[3], cy + s * twist[4], cz + s * twist[5]


@step_kernel
def _whitened(noise, last, travelled, before, u, v):
    """Inverse covariance (uu, uv, vv) of the change of a residual, and squared norm of the change.

    The change is counted from the observation ``before``.
    """
    uu = noise[3] * (noise[0] * last[0] + noise[1] * abs(travelled[0] - before[0]) + noise[2])
    uv = noise[3] * (noise[0] * last[1] + noise[1] * (travelled[1] - before[1]))
    vv = noise[3] * (noise[0] * last[2] + noise[1] * abs(travelled[2] - before[2]) + noise[2])
    det = uu * vv - uv * uv
    inverse = 1.0 / det if det > 0.0 else 0.0
    uu, uv, vv = vv * inverse, -uv * inverse, uu * inverse
    return uu, uv, vv, uu * u * u + 2.0 * uv * u * v + vv * v * v


@loop_kernel
def by_sigmas(by_parameters, factor, out):
    """Product ``by_parameters @ factor`` (N, 2, r), computed without the threads of BLAS.

    The factors have the shapes (N, 2, P) and (P, r).
    """
    for n in range(len(out)):
        for q in range(2):
            for i in range(factor.shape[1]):
                total = 0.0
                for k in range(factor.shape[0]):
                    total += by_parameters[n, q, k] * factor[k, i]
                out[n, q, i] = total


@loop_kernel
def expected_rays(
    R, p, twist, readout, lens, frame, point, row_phase, rays, ray_by_lens, anchor, s, out
):
    """Predicted unit rays (N, 3) of points. The arguments are those of `pixel_residuals`."""
    for o in range(len(frame)):
        j = point[o]
        a = anchor[j]
        k, ka, sj = frame[o], frame[a], s[j]
        bx, by, bz = rays[j, 0], rays[j, 1], rays[j, 2]
        for i in range(len(lens)):
            bx += ray_by_lens[j, 0, i] * lens[i]
            by += ray_by_lens[j, 1, i] * lens[i]
            bz += ray_by_lens[j, 2, i] * lens[i]
        wx, wy, wz = _rotated(R[ka], bx, by, bz)
        ux, uy, uz = _lag(twist[ka], wx, wy, wz, sj)
        late = readout * row_phase[a]
        dx = wx + late * ux + sj * (p[ka, 0] - p[k, 0])
        dy = wy + late * uy + sj * (p[ka, 1] - p[k, 1])
        dz = wz + late * uz + sj * (p[ka, 2] - p[k, 2])
        vx, vy, vz = _lag(twist[k], dx, dy, dz, sj)
        late = readout * row_phase[o]
        cx, cy, cz = _rotated_back(R[k], dx - late * vx, dy - late * vy, dz - late * vz)
        scale = 1.0 / math.sqrt(cx * cx + cy * cy + cz * cz)
        out[o, 0], out[o, 1], out[o, 2] = cx * scale, cy * scale, cz * scale


@loop_kernel
def pixel_residuals(
    R, p, twist, readout, lens,
    frame, point, row_phase, rays, ray_by_lens,
    expected, offsets, by_ray, by_lens,
    anchor, s, used,
    residuals, by_pose, by_common, by_s,
):  # fmt: skip
    """Predicted minus observed pixel of every observation, and derivatives of this residual.

    Parameters
    ----------
    R, p, twist : (K, 3, 3), (K, 3), (K, 6)
        Poses of the keyframes in world axes, and their angular and linear velocities, per s.
    readout : float
        Read-out time, s.
    lens : (r,)
        Change of the lens since rays and derivatives were computed, in sigmas.
    frame, point : (N,)
        Keyframe and point of each observation, in ascending order of keyframes.
    row_phase : (N,)
        Time at which the row of an observation is read, from -1/2 to 1/2 of the read-out time.
    rays, ray_by_lens : (M, 3), (M, 3, r)
        Ray of each point in its anchor, and derivative of this ray by the lens.
    expected, offsets, by_ray, by_lens : (N, 3), (N, 2), (N, 2, 3), (N, 2, r)
        Ray near the predicted ray, pixel of this ray minus observed pixel, and derivatives of this
        pixel by the ray and by the lens.
    anchor : (M,)
        Observation that is the anchor of each point.
    s : (M,)
        Inverse depths.
    used : (M,)
        Whether the point is used.
    residuals, by_pose, by_common, by_s : (N, 2), (N, 2, 6), (N, 2, r + 1), (N, 2)
        Results: residuals, and derivatives by the observer's pose, by lens and read-out time, and
        by the inverse depth. If a point is not in front of the camera, the residual is `UNSEEN_PX`.
        The derivatives of such points and of anchors are not written.
    """
    r = len(lens)
    for o in range(len(frame)):
        j = point[o]
        a = anchor[j]
        residuals[o, 0] = residuals[o, 1] = 0.0
        if o == a or not used[j]:
            continue
        k, ka, sj = frame[o], frame[a], s[j]
        bx, by, bz = rays[j, 0], rays[j, 1], rays[j, 2]
        for i in range(r):
            bx += ray_by_lens[j, 0, i] * lens[i]
            by += ray_by_lens[j, 1, i] * lens[i]
            bz += ray_by_lens[j, 2, i] * lens[i]
        wx, wy, wz = _rotated(R[ka], bx, by, bz)
        ux, uy, uz = _lag(twist[ka], wx, wy, wz, sj)
        phase_a, phase = row_phase[a], row_phase[o]
        ux, uy, uz = phase_a * ux, phase_a * uy, phase_a * uz
        X = wx + sj * p[ka, 0] + readout * ux
        Y = wy + sj * p[ka, 1] + readout * uy
        Z = wz + sj * p[ka, 2] + readout * uz
        dx, dy, dz = X - sj * p[k, 0], Y - sj * p[k, 1], Z - sj * p[k, 2]
        vx, vy, vz = _lag(twist[k], dx, dy, dz, sj)
        vx, vy, vz = phase * vx, phase * vy, phase * vz
        cx, cy, cz = _rotated_back(R[k], dx - readout * vx, dy - readout * vy, dz - readout * vz)
        depth = expected[o, 0] * cx + expected[o, 1] * cy + expected[o, 2] * cz
        if not depth > MIN_FACING_COSINE * math.sqrt(cx * cx + cy * cy + cz * cz):
            residuals[o, 0] = residuals[o, 1] = UNSEEN_PX
            continue
        inverse = 1.0 / depth
        late_a, late = readout * phase_a, readout * phase
        ex = p[ka, 0] - p[k, 0] + late_a * twist[ka, 3] - late * twist[k, 3]
        ey = p[ka, 1] - p[k, 1] + late_a * twist[ka, 4] - late * twist[k, 4]
        ez = p[ka, 2] - p[k, 2] + late_a * twist[ka, 5] - late * twist[k, 5]
        for q in range(2):
            pixel = inverse * (by_ray[o, q, 0] * cx + by_ray[o, q, 1] * cy + by_ray[o, q, 2] * cz)
            mx, my, mz = _rotated(
                R[k],
                (by_ray[o, q, 0] - pixel * expected[o, 0]) * inverse,
                (by_ray[o, q, 1] - pixel * expected[o, 1]) * inverse,
                (by_ray[o, q, 2] - pixel * expected[o, 2]) * inverse,
            )
            pixel += offsets[o, q]
            nx, ny, nz = _rotated_back(R[ka], mx, my, mz)
            for i in range(r):
                pixel += by_lens[o, q, i] * lens[i]
                by_common[o, q, i] = (
                    by_lens[o, q, i]
                    + nx * ray_by_lens[j, 0, i]
                    + ny * ray_by_lens[j, 1, i]
                    + nz * ray_by_lens[j, 2, i]
                )
            by_common[o, q, r] = mx * (ux - vx) + my * (uy - vy) + mz * (uz - vz)
            tx, ty, tz = _cross(mx, my, mz, X, Y, Z)
            by_pose[o, q, 0], by_pose[o, q, 1], by_pose[o, q, 2] = tx, ty, tz
            by_pose[o, q, 3], by_pose[o, q, 4], by_pose[o, q, 5] = -sj * mx, -sj * my, -sj * mz
            by_s[o, q] = mx * ex + my * ey + mz * ez
            residuals[o, q] = pixel


@loop_kernel
def gather_information(
    frame, point, last, travelled, anchor, used, noise,
    residuals, by_pose, by_common, by_s,
    patch, before, H, g, coupling, point_h, point_g, patch_sums, point_sums,
):  # fmt: skip
    """Information (D, D) and gradient (D,) of poses and common unknowns, and of the points.

    Errors of a track accumulate from match to match. The residual of a term is therefore the change
    since the last keyframe that observed the track. The D unknowns are 6 for each keyframe, then
    the lens, then the read-out time.

    Parameters
    ----------
    last, travelled : (N, 3)
        Covariance (uu, uv, vv), px^2, of the last match, and sum of the covariances since the track
        began.
    noise : (4,)
        Weight of the last covariance, weight of the summed covariances, floor (px^2), and factor on
        the variance.
    patch : (N,) of int
        Part of the image in which the observation lies.
    before : (M,) of int
        Buffer.
    H, g, coupling, point_h, point_g : (D, D), (D,), (M, D), (M,), (M,)
        Results, initially zero: information and gradient of poses and common unknowns, their
        coupling with the inverse depths, information and gradient of the inverse depths.
    patch_sums, point_sums : (P, 2), (M, 2)
        Results, initially zero: sums over patches and over points of residuals in units of their
        sigma, times their weights.

    Returns
    -------
    (float, float, int)
        Sum of the weighted squared residuals, sum of the squares of the numbers that were added to
        ``patch_sums``, and number of terms.
    """
    D, G = len(g), by_common.shape[2]
    J, where = np.empty((2, 18 + G)), np.empty(18 + G, np.int64)
    e, E = np.empty(2), np.empty(2)
    before[:] = -1
    squares, influence, count = 0.0, 0.0, 0
    for o in range(len(frame)):
        j = point[o]
        a = anchor[j]
        if not used[j]:
            continue
        if o == a:
            before[j] = o
            continue
        b = before[j]
        if b < 0 or residuals[o, 0] == UNSEEN_PX:
            continue
        before[j] = o
        is_first = b == a
        n = 12 if is_first else 18
        for i in range(6):
            where[i], where[6 + i], where[12 + i] = (
                6 * frame[o] + i,
                6 * frame[a] + i,
                6 * frame[b] + i,
            )
        for i in range(G):
            where[n + i] = D - G + i
        for q in range(2):
            e[q], E[q] = residuals[o, q], by_s[o, q]
            for i in range(6):
                J[q, i], J[q, 6 + i] = by_pose[o, q, i], -by_pose[o, q, i]
            for i in range(G):
                J[q, n + i] = by_common[o, q, i]
            if not is_first:
                e[q] -= residuals[b, q]
                E[q] -= by_s[b, q]
                for i in range(6):
                    J[q, 6 + i] += by_pose[b, q, i]
                    J[q, 12 + i] = -by_pose[b, q, i]
                for i in range(G):
                    J[q, n + i] -= by_common[b, q, i]
        n += G
        uu, uv, vv, square = _whitened(noise, last[o], travelled[o], travelled[b], e[0], e[1])
        if not uu > 0.0:
            continue
        weight = (STUDENT_FREEDOM + 2.0) / (STUDENT_FREEDOM + square)
        squares += weight * square
        count += 1
        # Root of the weighted inverse covariance: both rows have unit variance.
        c00 = math.sqrt(weight * uu)
        c01 = weight * uv / c00
        c11 = math.sqrt(max(weight * vv - c01 * c01, 0.0))
        for i in range(n):
            J[0, i], J[1, i] = c00 * J[0, i] + c01 * J[1, i], c11 * J[1, i]
        E[0], E[1] = c00 * E[0] + c01 * E[1], c11 * E[1]
        e[0], e[1] = c00 * e[0] + c01 * e[1], c11 * e[1]
        root = math.sqrt(weight)
        for q in range(2):
            patch_sums[patch[o], q] += root * e[q]
            point_sums[j, q] += root * e[q]
            influence += weight * e[q] * e[q]
        for i in range(n):
            a0, a1, row = J[0, i], J[1, i], where[i]
            g[row] += a0 * e[0] + a1 * e[1]
            coupling[j, row] += a0 * E[0] + a1 * E[1]
            for m in range(i + 1):
                H[row, where[m]] += a0 * J[0, m] + a1 * J[1, m]
        point_h[j] += E[0] * E[0] + E[1] * E[1]
        point_g[j] += E[0] * e[0] + E[1] * e[1]
    # Each product was added on one side of the diagonal only.
    for i in range(D):
        for m in range(i):
            H[i, m] = H[m, i] = H[i, m] + H[m, i]
    return squares, influence, count


@loop_kernel
def robust_cost(point, last, travelled, anchor, used, noise, residuals, before):
    """Negative log likelihood of `gather_information`'s residuals, up to a constant."""
    before[:] = -1
    cost = 0.0
    for o in range(len(point)):
        j = point[o]
        if not used[j]:
            continue
        if o == anchor[j]:
            before[j] = o
            continue
        b = before[j]
        if b < 0:
            continue
        if residuals[o, 0] == UNSEEN_PX:
            cost += UNSEEN_COST
            continue
        before[j] = o
        du, dv = residuals[o, 0] - residuals[b, 0], residuals[o, 1] - residuals[b, 1]
        square = _whitened(noise, last[o], travelled[o], travelled[b], du, dv)[3]
        cost += 0.5 * (STUDENT_FREEDOM + 2.0) * math.log(1.0 + square / STUDENT_FREEDOM)
    return cost


@loop_kernel
def point_steps(coupling, point_h, point_g, step, damping, steps):
    """Changes (M,) of the inverse depths for a step (D,) of the other unknowns."""
    for j in range(len(steps)):
        total = point_g[j]
        for i in range(len(step)):
            total += coupling[j, i] * step[i]
        steps[j] = -total / (point_h[j] + damping)


@inner_kernel
def _velocity(R, R0, p, p0, rate, twist):
    """Rotation vector and displacement from one pose to another, times a rate."""
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
        cx, cy, cz = _cross(x, y, z, rx, ry, rz)
        dx, dy, dz = _cross(x, y, z, cx, cy, cz)
        R[0, i], R[1, i], R[2, i] = rx + a * cx + b * dx, ry + a * cy + b * dy, rz + a * cz + b * dz


@inner_kernel
def _solved(H, g, x):
    """Solve ``H x = g`` by Cholesky; False if H is not positive definite."""
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


@loop_kernel
def locate(
    R, p, R0, p0, seconds, readout, offsets, row_phase, expected, by_ray, covariances, inflations,
    X, s, s_variance, base, before_by_s, H, squares,
):  # fmt: skip
    """Gauss-Newton steps of a pose by known points.

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
        Factors on the covariances for each step: above 1 for an initial pose with large errors.
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
        Robust cost before the last step, and number of points in the cost; 0 if a step failed.
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
            sj = s[o]
            dx, dy, dz = X[o, 0] - sj * p[0], X[o, 1] - sj * p[1], X[o, 2] - sj * p[2]
            late = row_phase[o] * readout
            vx, vy, vz = _lag(twist, dx, dy, dz, sj)
            cx, cy, cz = _rotated_back(R, dx - late * vx, dy - late * vy, dz - late * vz)
            depth = expected[o, 0] * cx + expected[o, 1] * cy + expected[o, 2] * cz
            if not depth > MIN_FACING_COSINE * math.sqrt(cx * cx + cy * cy + cz * cz):
                continue
            inverse = 1.0 / depth
            for q in range(2):
                ux, uy, uz = by_ray[o, q, 0], by_ray[o, q, 1], by_ray[o, q, 2]
                pixel = inverse * (ux * cx + uy * cy + uz * cz)
                m[q, 0], m[q, 1], m[q, 2] = _rotated(
                    R,
                    (ux - pixel * expected[o, 0]) * inverse,
                    (uy - pixel * expected[o, 1]) * inverse,
                    (uz - pixel * expected[o, 2]) * inverse,
                )
                e[q] = pixel + offsets[o, q]
                E[q] = (
                    m[q, 0] * (base[o, 0] - p[0])
                    + m[q, 1] * (base[o, 1] - p[1])
                    + m[q, 2] * (base[o, 2] - p[2])
                    - before_by_s[o, q]
                )
                tx, ty, tz = _cross(m[q, 0], m[q, 1], m[q, 2], dx, dy, dz)
                J[q, 0], J[q, 1], J[q, 2] = tx, ty, tz
                J[q, 3], J[q, 4], J[q, 5] = -sj * m[q, 0], -sj * m[q, 1], -sj * m[q, 2]
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
