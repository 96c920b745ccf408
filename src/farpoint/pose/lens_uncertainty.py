"""Uncertainty of the calibration in a motion: its covariance, and whether it has a direction.

An error of the lens is not noise: it displaces all matches together, and no number of them averages
it out. The covariance of a motion ``x`` by a lens of parameters ``c`` therefore grows by
``J S J.T``, with ``S`` the covariance of ``c`` and ``J = dx/dc`` at the optimum, by the implicit
function theorem: ``J = -H^-1 sum(w dr/dx dr/dc)`` for weighted residuals ``r(x, c)`` of information
``H``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy

from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.geometry import so3
from farpoint.geometry.sphere import normalize, tangent_basis
from farpoint.pose.conclusion import with_covariance
from farpoint.pose.result import PoseStatus, RelativePose, TrackLabel
from farpoint.pose.shutter import Shutter

__all__ = ["View", "with_lens_uncertainty"]

_MOST = 200
"""Inliers that J is taken from, spread over all: J is a ratio of two sums over the same matches."""

_STEPS = 10
"""Gauss-Newton steps, at most."""

_NEGLIGIBLE = 0.01
"""Step of an error of the lens, in its sigmas, that ends them (convention)."""

_OF_SHUTTER = 4
"""Errors of a shutter: its read-out, and the derivative of the angular velocity (3)."""

_LINEAR = 0.5
"""Change of an error of the lens, in its sigmas, up to which rays are linear in it."""

_DOF = 5.0
"""Degrees of freedom of the t distribution of what a rotation leaves: heavy tails (convention)."""


class View(NamedTuple):
    """Pixels of the matches in one image, shape (N, 2), and the camera that took it."""

    points: np.ndarray
    camera: Camera


def with_lens_uncertainty(
    pose: RelativePose,
    view0: View,
    view1: View,
    shutter: Shutter | None,
    is_observable: Callable[[Camera, Camera, Shutter | None], bool],
    false_alarm_rate: float,
) -> RelativePose:
    """The motion with a covariance that holds the uncertainty of its cameras and their shutter.

    No direction is observable where the lens alone may have made the flow: where the lens, within
    its uncertainty, that explains most of the flow by a rotation shows no direction.

    Parameters
    ----------
    pose : RelativePose
        By the given cameras.
    view0, view1 : View
        Of its matches. If both have the same camera, its error is common to both.
    shutter : Shutter or None
        None for a global one.
    is_observable : callable
        Whether the same pixels show a direction by other cameras and another shutter.
    false_alarm_rate : float
        Lenses less probable than this are excluded; flows that noise explains at this rate do not
        contradict a rotation.

    Returns
    -------
    RelativePose
        The same pose where the cameras are exact, or it FAILED.
    """
    is_exact = shutter is None or shutter.sigma == shutter.angular_prior_sigma == 0.0
    if pose.status is PoseStatus.FAILED or (
        is_exact and all(v.camera.uncertainty is None for v in (view0, view1))
    ):
        return pose
    assert pose.rotation_cam1_from_cam0 is not None
    theta = so3.log(pose.rotation_cam1_from_cam0)
    lenses = _Lenses.of(view0.camera, view1.camera, shutter, theta)
    inliers = np.flatnonzero(pose.labels != TrackLabel.OUTLIER)
    inliers = inliers[:: max(-(-len(inliers) // _MOST), 1)]
    views = view0, view1
    rays = lenses.rays(*views, inliers)
    if pose.status is PoseStatus.OK:
        errors = _explained_by_a_rotation(lenses, views, inliers, rays, pose, false_alarm_rate)
        if errors is not None and not is_observable(*lenses.at(errors)):
            pose = _without_direction(pose)
    by_lens = _sensitivity(pose, *rays)
    spread = by_lens @ by_lens.T
    if pose.covariance is not None:
        return with_covariance(pose, pose.covariance + spread)
    assert pose.rotation_covariance is not None
    return replace(pose, rotation_covariance=pose.rotation_covariance + spread)


class _Rays(NamedTuple):
    """Unit rays (N, 3), their derivatives by the pixel (N, 3, 2) and by ``z`` (N, 3, r)."""

    rays: np.ndarray
    by_pixel: np.ndarray
    by_lens: np.ndarray

    def by_error(self, z: np.ndarray) -> _Rays:
        """Those of lenses with errors (r,), to first order."""
        return self._replace(rays=normalize(self.rays + self.by_lens @ z))


class _Lenses(NamedTuple):
    """Both cameras as functions of ``z`` (r,), errors of their lenses in units of one sigma.

    ``factors`` are of the parameters (P, r) of ``camera.refinable``. The last four errors are those
    of the read-out and of the derivative of the angular velocity, behind a shutter that undoes the
    share of the rotation vector ``theta`` in each row.
    """

    cameras: tuple[Camera, Camera]
    factors: tuple[np.ndarray, np.ndarray]
    shutter: Shutter | None
    theta: np.ndarray

    @classmethod
    def of(
        cls, camera0: Camera, camera1: Camera, shutter: Shutter | None, theta: np.ndarray
    ) -> _Lenses:
        """One camera twice shares its errors; those of two are independent."""
        first = second = camera0.parameter_factor
        if camera0 is not camera1 and camera0 != camera1:
            second = camera1.parameter_factor
            r0, r1 = first.shape[1], second.shape[1]
            first, second = np.pad(first, ((0, 0), (0, r1))), np.pad(second, ((0, 0), (r0, 0)))
        last = ((0, 0), (0, _OF_SHUTTER))
        factors = np.pad(first, last), np.pad(second, last)
        return cls((camera0, camera1), factors, shutter, theta)

    def rays(
        self, view0: View, view1: View, rows: np.ndarray, z: np.ndarray | None = None
    ) -> tuple[_Rays, _Rays]:
        """Rays of both images at these matches, by the given lenses or by those with errors z."""
        cameras, shutter = self.cameras, self.shutter
        if z is not None and z.any():
            *cameras, shutter = self.at(z)
        views = (view0, view1)
        first, second = (
            _rays_of(camera, factor, view.points[rows])
            for camera, factor, view in zip(cameras, self.factors, views, strict=True)
        )
        if shutter is None:
            return first, second
        shutter = shutter.select(rows)
        return _unrolled(first, 0, shutter, self.theta), _unrolled(second, 1, shutter, self.theta)

    def at(self, z: np.ndarray) -> tuple[Camera, Camera, Shutter | None]:
        """Exact cameras with these errors of the lenses, halved until the lens is valid."""
        shutter = self.shutter
        if shutter is not None:
            readout, derivative = float(z[-_OF_SHUTTER]), z[1 - _OF_SHUTTER :]
            shutter = shutter._replace(
                share=shutter.share + readout * shutter.sigma,
                derivative=shutter.derivative + derivative * shutter.angular_prior_sigma,
            )
        first = _with_error(self.cameras[0], self.factors[0] @ z)
        if self.cameras[0] is self.cameras[1]:
            return first, first, shutter
        return first, _with_error(self.cameras[1], self.factors[1] @ z), shutter


def _unrolled(rays: _Rays, image: int, shutter: Shutter, theta: np.ndarray) -> _Rays:
    """Rays with the rotation undone up to the read-out of their rows."""
    unrolled, by_pixel = shutter.unrolled(theta, image, rays.rays, rays.by_pixel)
    by_lens = shutter.row_corrections(theta, image) @ rays.by_lens
    phases = shutter.phases(image)[:, None]
    by_readout = np.cross((-shutter.sigma * phases) * shutter.rate(theta, image), unrolled)
    by_lens[:, :, -_OF_SHUTTER] = by_readout
    if shutter.angular_prior is not None:
        rate = shutter.angular_prior.by_derivative[image] * shutter.angular_prior.sigma
        for axis in range(3):
            turn = -shutter.share * rate * phases * np.eye(3)[axis]
            by_lens[:, :, 1 - _OF_SHUTTER + axis] = np.cross(turn, unrolled)
    return _Rays(unrolled, by_pixel, by_lens)


def _rays_of(camera: Camera, factor: np.ndarray, points: np.ndarray) -> _Rays:
    lens = camera.refinable
    rays = camera.unproject(np.asarray(points, np.float64))
    return _Rays(
        rays,
        camera.unproject_jacobian(rays),
        lens.unproject_parameter_jacobian(rays) @ factor,
    )


def _with_error(camera: Camera, error: np.ndarray) -> Camera:
    lens = camera.refinable
    given = np.array(list(lens.parameters.values()))
    for _ in range(10):
        try:
            return replace(camera, model=lens.with_parameters(given + error), uncertainty=None)
        except InputError:
            error = 0.5 * error
    return camera.with_uncertainty()


def _sensitivity(pose: RelativePose, rays0: _Rays, rays1: _Rays) -> np.ndarray:
    """``dx/dz`` (5, r) of ``x = [dtheta, dbeta]``, or (3, r) of ``dtheta``, at the estimate."""
    R, t = pose.rotation_cam1_from_cam0, pose.direction_cam1_from_cam0
    assert R is not None
    if t is None:
        flow = _Flow.of(R, rays0, rays1)
        by_x = np.concatenate([flow.by_rotation, flow.by_lens], axis=2).reshape(-1, 3 + flow.size)
        weight = np.repeat(1.0 / flow.variance, 2)
        return _solved(by_x[:, :3], by_x[:, 3:], weight)
    assert pose.direction_basis is not None
    a, b = rays0.rays @ R.T, rays1.rays
    # e = b . (t x R a), the residual across the epipolar plane, and its derivatives.
    across0, across1 = np.cross(b, t), np.cross(t, a)
    rotated0 = across0 @ R
    by_x = np.hstack([np.cross(a, across0), np.cross(a, b) @ pose.direction_basis])
    by_lens = np.einsum("ni,nir->nr", rotated0, rays0.by_lens) + np.einsum(
        "ni,nir->nr", across1, rays1.by_lens
    )
    variance = _variance(rotated0, rays0) + _variance(across1, rays1)
    return _solved(by_x, by_lens, 1.0 / variance)


def _variance(direction: np.ndarray, rays: _Rays) -> np.ndarray:
    """Variance (N,) of ``direction . ray`` for one px^2 of each coordinate of the pixel."""
    by_pixel = np.einsum("ni,nij->nj", direction, rays.by_pixel)
    return np.maximum(np.sum(by_pixel**2, axis=1), np.finfo(float).tiny)


def _solved(by_x: np.ndarray, by_lens: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """``-H^-1 sum(w dr/dx dr/dz)``; no change along what the matches do not fix."""
    known = np.isfinite(weight) & np.isfinite(by_x).all(axis=1) & np.isfinite(by_lens).all(axis=1)
    weighted = (by_x * weight[:, None])[known]
    return -np.linalg.pinv(weighted.T @ by_x[known], hermitian=True) @ (weighted.T @ by_lens[known])


class _Flow(NamedTuple):
    """The derotated flow, ``b - R a`` in the plane across ``b``.

    ``left`` (N, 2), with its derivatives by ``dtheta`` (N, 2, 3) and ``z`` (N, 2, r), and its
    variance (N,) along one direction for one px^2.
    """

    left: np.ndarray
    by_rotation: np.ndarray
    by_lens: np.ndarray
    variance: np.ndarray

    @property
    def size(self) -> int:
        """Number of errors of the lenses."""
        return self.by_lens.shape[2]

    @classmethod
    def of(cls, R: np.ndarray, rays0: _Rays, rays1: _Rays) -> _Flow:
        """Without the rotation ``R`` (3, 3), camera 1 from camera 0."""
        a, b = rays0.rays @ R.T, rays1.rays
        basis = tangent_basis(b).transpose(0, 2, 1)
        crossed = np.cross(a[:, None], np.eye(3)).transpose(0, 2, 1)
        noise = np.sum(rays1.by_pixel**2, axis=(1, 2)) + np.sum(rays0.by_pixel**2, axis=(1, 2))
        return cls(
            left=np.einsum("nki,ni->nk", basis, b - a),
            by_rotation=basis @ crossed,
            by_lens=basis @ (rays1.by_lens - R @ rays0.by_lens),
            variance=np.maximum(0.5 * noise, np.finfo(float).tiny),
        )


def _explained_by_a_rotation(
    lenses: _Lenses,
    views: tuple[View, View],
    rows: np.ndarray,
    rays: tuple[_Rays, _Rays],
    pose: RelativePose,
    rate: float,
) -> np.ndarray | None:
    """Errors of the lenses (r,) with which a rotation explains most of the flow.

    None where most of the matches contradict a rotation through every lens. The maximum over
    ``dtheta`` and ``z`` of a likelihood with heavy tails (the points that carry translation) and
    of the prior of ``z``, by Gauss-Newton; near where they were taken, rays are linear in ``z``.
    """
    R, noise_px = pose.rotation_cam1_from_cam0, pose.noise_px
    assert R is not None
    assert noise_px is not None
    z = np.zeros(lenses.factors[0].shape[1])
    prior = np.diag([0.0] * 3 + [1.0] * len(z))
    farthest2 = float(scipy.special.chdtri(float(len(z)), rate))
    contradicts2 = float(scipy.special.chdtri(2.0, rate))
    taken = z
    for _ in range(_STEPS):
        if float(np.abs(z - taken).max(initial=0.0)) > _LINEAR:
            taken, rays = z, lenses.rays(*views, rows, z)
        flow = _Flow.of(R, *(each.by_error(z - taken) for each in rays))
        by_x = np.concatenate([flow.by_rotation, flow.by_lens], axis=2)
        scale = 1.0 / (noise_px * np.sqrt(flow.variance))
        left, by_x = flow.left * scale[:, None], by_x * scale[:, None, None]
        # Rays that do not exist with a lens in error are left out.
        exists = np.isfinite(left).all(axis=1) & np.isfinite(by_x).all(axis=(1, 2))
        left, by_x = left[exists], by_x[exists]
        distance2 = np.sum(left**2, axis=1)
        weight = (_DOF + 2.0) / (_DOF + distance2)
        rows_by_x = by_x.reshape(-1, len(prior))
        weighted = rows_by_x * np.repeat(weight, 2)[:, None]
        H = weighted.T @ rows_by_x + prior
        g = weighted.T @ left.reshape(-1) + prior @ np.concatenate([np.zeros(3), z])
        step = -np.linalg.pinv(H, hermitian=True) @ g
        if np.median(np.sum((left + by_x @ step) ** 2, axis=1)) > contradicts2:
            return None
        R, z = so3.exp(step[:3]) @ R, z + step[3:]
        z = z * min(1.0, np.sqrt(farthest2 / max(float(z @ z), 1e-300)))
        if float(np.abs(step[3:]).max(initial=0.0)) < _NEGLIGIBLE:
            break
    return z


def _without_direction(pose: RelativePose) -> RelativePose:
    stats = pose.stats
    return replace(
        pose,
        status=PoseStatus.ROTATION_ONLY,
        reason="Pure rotation possible: a lens within its stated uncertainty explains the flow by "
        "a rotation alone.",
        direction_cam1_from_cam0=None,
        direction_basis=None,
        covariance=None,
        labels=np.minimum(pose.labels, np.uint8(TrackLabel.FAR)),
        stats=replace(stats, far=stats.far + stats.near, near=0, sign_probability=None),
    )
