"""Predicted rays and pixels of points in the keyframes of a window, and their derivatives.

A point has the ray ``b`` in its anchor, keyframe a, and the inverse depth ``s``. In world axes and
up to scale, the point is ``X = R_a b + s p_a``. Keyframe k observes the point along ``R_k^T (X - s
p_k)``. The projection of this ray is compared with the observed pixel. Poses are perturbed in world
axes as ``R' = Exp(theta) R``, ``p' = Exp(theta) p + rho``. With this perturbation, the derivative
by the anchor's pose is minus the derivative by the observer's pose. Rolling shutter: a camera that
rotates by ``w`` and moves by ``v`` per second observes the point at ``X - t (w x (X - s p) + s v)``
in a row that is read the time t after the middle row.

The functions write their results into arrays that the caller passes.
"""

from __future__ import annotations

import math

from farpoint._kernels.compile import loop_kernel, step_kernel
from farpoint.path.constants import MIN_FACING_COSINE, UNSEEN_PX
from farpoint.path.kernels.geometry import cross, lag, rotated, rotated_back

__all__ = ["by_sigmas", "expected_rays", "pixel_residuals"]


@loop_kernel
def by_sigmas(by_parameters, factor, out):
    """Product ``by_parameters @ factor`` (N, 2, r), computed without the threads of BLAS.

    The matrices have the shapes (N, 2, P) and (P, r).
    """
    for n in range(len(out)):
        for q in range(2):
            for i in range(factor.shape[1]):
                total = 0.0
                for k in range(factor.shape[0]):
                    total += by_parameters[n, q, k] * factor[k, i]
                out[n, q, i] = total


@step_kernel
def _anchor_ray(R, ray, by_lens, lens):
    """Ray of a point in its anchor, in world axes, for a lens that has changed by ``lens`` (r,)."""
    x, y, z = ray[0], ray[1], ray[2]
    for i in range(len(lens)):
        x += by_lens[0, i] * lens[i]
        y += by_lens[1, i] * lens[i]
        z += by_lens[2, i] * lens[i]
    return rotated(R, x, y, z)


@loop_kernel
def expected_rays(
    R, p, twist, readout, lens, frame, point, row_phase, rays, ray_by_lens, anchor, s, out
):
    """Predicted unit ray of every observation. The arguments are those of `pixel_residuals`.

    ``out`` (N, 3) receives the rays.
    """
    for o in range(len(frame)):
        j = point[o]
        a = anchor[j]
        k, ka, sj = frame[o], frame[a], s[j]
        wx, wy, wz = _anchor_ray(R[ka], rays[j], ray_by_lens[j], lens)
        ux, uy, uz = lag(twist[ka], wx, wy, wz, sj)
        late = readout * row_phase[a]
        dx = wx + late * ux + sj * (p[ka, 0] - p[k, 0])
        dy = wy + late * uy + sj * (p[ka, 1] - p[k, 1])
        dz = wz + late * uz + sj * (p[ka, 2] - p[k, 2])
        vx, vy, vz = lag(twist[k], dx, dy, dz, sj)
        late = readout * row_phase[o]
        cx, cy, cz = rotated_back(R[k], dx - late * vx, dy - late * vy, dz - late * vz)
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
        Unit ray near the predicted ray, pixel of this unit ray minus observed pixel, and
        derivatives of the pixel by the ray and by the lens.
    anchor : (M,)
        Observation that is the anchor of each point.
    s : (M,)
        Inverse depths.
    used : (M,)
        Whether the point is used. The residuals of other points are 0.
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
        wx, wy, wz = _anchor_ray(R[ka], rays[j], ray_by_lens[j], lens)
        ux, uy, uz = lag(twist[ka], wx, wy, wz, sj)
        phase_a, phase = row_phase[a], row_phase[o]
        ux, uy, uz = phase_a * ux, phase_a * uy, phase_a * uz
        X = wx + sj * p[ka, 0] + readout * ux
        Y = wy + sj * p[ka, 1] + readout * uy
        Z = wz + sj * p[ka, 2] + readout * uz
        dx, dy, dz = X - sj * p[k, 0], Y - sj * p[k, 1], Z - sj * p[k, 2]
        vx, vy, vz = lag(twist[k], dx, dy, dz, sj)
        vx, vy, vz = phase * vx, phase * vy, phase * vz
        cx, cy, cz = rotated_back(R[k], dx - readout * vx, dy - readout * vy, dz - readout * vz)
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
            mx, my, mz = rotated(
                R[k],
                (by_ray[o, q, 0] - pixel * expected[o, 0]) * inverse,
                (by_ray[o, q, 1] - pixel * expected[o, 1]) * inverse,
                (by_ray[o, q, 2] - pixel * expected[o, 2]) * inverse,
            )
            pixel += offsets[o, q]
            nx, ny, nz = rotated_back(R[ka], mx, my, mz)
            for i in range(r):
                pixel += by_lens[o, q, i] * lens[i]
                by_common[o, q, i] = (
                    by_lens[o, q, i]
                    + nx * ray_by_lens[j, 0, i]
                    + ny * ray_by_lens[j, 1, i]
                    + nz * ray_by_lens[j, 2, i]
                )
            by_common[o, q, r] = mx * (ux - vx) + my * (uy - vy) + mz * (uz - vz)
            tx, ty, tz = cross(mx, my, mz, X, Y, Z)
            by_pose[o, q, 0], by_pose[o, q, 1], by_pose[o, q, 2] = tx, ty, tz
            by_pose[o, q, 3], by_pose[o, q, 4], by_pose[o, q, 5] = -sj * mx, -sj * my, -sj * mz
            by_s[o, q] = mx * ex + my * ey + mz * ez
            residuals[o, q] = pixel
