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

from farpoint._kernels.compile import loop_kernel, step_kernel
from farpoint._kernels.vectors import (
    axpby,
    cross,
    dot,
    matrix,
    norm,
    rotate,
    rotate_back,
    vector,
)
from farpoint.path.constants import MIN_FACING_COSINE, UNSEEN_PX

__all__ = ["by_point_and_pose", "by_sigmas", "expected_rays", "is_facing", "lag", "pixel_residuals"]


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
def lag(twist, d, s):
    """``w x d + s v``: change per second of a homogeneous point that moves with the camera.

    ``w`` and ``v`` are the angular and the linear velocity, ``twist = [w, v]``, ``d`` is the vector
    ``X - s p`` from the camera to the point, and ``s`` is the inverse depth.
    """
    return axpby(1.0, cross(vector(twist[:3]), d), s, vector(twist[3:]))


@step_kernel
def _anchor_ray(R, ray, by_lens, lens):
    """Ray of a point in its anchor, in world axes, for a lens that has changed by ``lens`` (r,)."""
    x, y, z = vector(ray)
    for i in range(len(lens)):
        x += by_lens[0, i] * lens[i]
        y += by_lens[1, i] * lens[i]
        z += by_lens[2, i] * lens[i]
    return rotate(matrix(R), (x, y, z))


@step_kernel
def _observed(
    o, R, p, twist, readout, lens, frame, point, row_phase, rays, ray_by_lens, anchor, s
):  # fmt: skip
    """The homogeneous point X of observation ``o``, and the observed point in camera axes.

    The function also returns the derivatives, in world axes, of the observed point by the read-out
    time and by the inverse depth.
    """
    j = point[o]
    a = anchor[j]
    k, ka = frame[o], frame[a]
    ray = _anchor_ray(R[ka], rays[j], ray_by_lens[j], lens)
    anchor_lag = lag(twist[ka], ray, s[j])
    at_anchor = axpby(1.0, vector(p[ka]), row_phase[a] * readout, vector(twist[ka, 3:]))
    at_observer = axpby(1.0, vector(p[k]), row_phase[o] * readout, vector(twist[k, 3:]))
    X = axpby(1.0, ray, s[j], vector(p[ka]))
    X = axpby(1.0, X, row_phase[a] * readout, anchor_lag)
    away = axpby(1.0, X, -s[j], vector(p[k]))
    own_lag = lag(twist[k], away, s[j])
    seen = rotate_back(matrix(R[k]), axpby(1.0, away, -row_phase[o] * readout, own_lag))
    by_readout = axpby(row_phase[a], anchor_lag, -row_phase[o], own_lag)
    return X, seen, by_readout, axpby(1.0, at_anchor, -1.0, at_observer)


@loop_kernel
def expected_rays(
    R, p, twist, readout, lens, frame, point, row_phase, rays, ray_by_lens, anchor, s, out
):
    """Predicted unit ray of every observation. The arguments are those of `pixel_residuals`.

    ``out`` (N, 3) receives the rays.
    """
    for o in range(len(frame)):
        _, seen, _, _ = _observed(
            o, R, p, twist, readout, lens, frame, point, row_phase, rays, ray_by_lens, anchor, s
        )
        out[o, 0], out[o, 1], out[o, 2] = axpby(1.0 / norm(seen), seen, 0.0, seen)


@step_kernel
def by_point_and_pose(R, by_ray, expected, seen, X, s, by_pose):
    """Change of a pixel from that of the unit ray ``expected``, and its derivative by the point.

    The point is ``seen`` in camera axes, and X is the homogeneous point from which the pose is
    perturbed. ``by_ray`` (3,) is the derivative of the pixel by the unit ray. ``by_pose`` (6,)
    receives the derivative by the pose of the observer, with the rotation about the origin of X.
    """
    inverse = 1.0 / dot(vector(expected), seen)
    change = inverse * dot(vector(by_ray), seen)
    by_seen = axpby(inverse, vector(by_ray), -inverse * change, vector(expected))
    by_point = rotate(matrix(R), by_seen)
    by_pose[0], by_pose[1], by_pose[2] = cross(by_point, X)
    by_pose[3], by_pose[4], by_pose[5] = axpby(-s, by_point, 0.0, by_point)
    return change, by_point


@step_kernel
def is_facing(expected, seen):
    """Whether a point that is ``seen`` in camera axes is near the unit ray ``expected``."""
    return dot(vector(expected), seen) > MIN_FACING_COSINE * norm(seen)


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
        residuals[o, 0] = residuals[o, 1] = 0.0
        if o == anchor[j] or not used[j]:
            continue
        X, seen, by_readout, by_depth = _observed(
            o, R, p, twist, readout, lens, frame, point, row_phase, rays, ray_by_lens, anchor, s
        )
        if not is_facing(expected[o], seen):
            residuals[o, 0] = residuals[o, 1] = UNSEEN_PX
            continue
        R_anchor = matrix(R[frame[anchor[j]]])
        for q in range(2):
            pixel, by_point = by_point_and_pose(
                R[frame[o]], by_ray[o, q], expected[o], seen, X, s[j], by_pose[o, q]
            )
            pixel += offsets[o, q]
            x, y, z = rotate_back(R_anchor, by_point)
            for i in range(r):
                by_own, by_anchor = by_lens[o, q, i], ray_by_lens[j, :, i]
                pixel += by_own * lens[i]
                by_common[o, q, i] = by_own + x * by_anchor[0] + y * by_anchor[1] + z * by_anchor[2]
            by_common[o, q, r] = dot(by_point, by_readout)
            by_s[o, q] = dot(by_point, by_depth)
            residuals[o, q] = pixel
