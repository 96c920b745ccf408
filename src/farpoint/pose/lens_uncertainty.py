"""Effect of an uncertain calibration: covariance of the motion, and test of the direction.

An error of the lens is not noise: the error displaces all matches together, and does not average
out over many matches. The covariance of a motion ``x`` therefore grows by ``J S J.T``, where ``S``
is the covariance of the lens parameters ``c`` and ``J`` is ``dx/dc`` at the optimum. By the
implicit function theorem ``J = -H^-1 sum(w dr/dx dr/dc)`` for residuals ``r(x, c)`` with weights
``w`` and information ``H``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy

from farpoint._kernels.constants import COARSE_STEPS, LINEAR_STEP_RAD, ROUNDING, STUDENT_FREEDOM
from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.geometry import so3
from farpoint.geometry.sphere import tangent_basis
from farpoint.geometry.vectors import cross, products
from farpoint.pose.conclusion import with_covariance
from farpoint.pose.constants import (
    IDENTITY,
    LENS_CONVERGED_SIGMA,
    LENS_INLIERS,
    LENS_LINEAR_SIGMA,
    SHUTTER_ERRORS,
)
from farpoint.pose.result import PoseStatus, RelativePose, TrackLabel
from farpoint.pose.shutter import Shutter

__all__ = ["View", "with_lens_uncertainty"]


class View(NamedTuple):
    """One image: the camera, and the pixels and rays of the matches.

    The rays are not yet corrected for the rolling shutter. Shapes: pixels (N, 2), rays (N, 3),
    derivatives of the rays by the pixel (N, 3, 2).
    """

    camera: Camera
    points: np.ndarray
    rays: np.ndarray
    by_pixel: np.ndarray

    def select(self, rows: np.ndarray) -> View:
        """The view with the given rows of the matches."""
        return View(self.camera, self.points[rows], self.rays[rows], self.by_pixel[rows])

    def through(self, camera: Camera) -> View:
        """The view with the same pixels and the rays of another camera."""
        rays = camera.unproject(self.points)
        return View(camera, self.points, rays, camera.unproject_jacobian(rays))


def with_lens_uncertainty(
    pose: RelativePose,
    view0: View,
    view1: View,
    shutter: Shutter | None,
    is_observable: Callable[[Camera, Camera, Shutter | None], bool],
    false_alarm_rate: float,
) -> RelativePose:
    """The motion with a covariance that includes the uncertainty of the cameras and of the shutter.

    The direction is dropped if an error of the lens may have caused the flow. For this test the
    lens is changed within its uncertainty until a rotation explains most of the flow. If the
    matches show no direction through the changed lens, the motion becomes `ROTATION_ONLY`.

    Parameters
    ----------
    pose : RelativePose
        Motion estimated with the given cameras.
    view0, view1 : View
        Views of the matches. If both views have the same camera, they have the same lens error.
    shutter : Shutter or None
        Rolling shutter; None for a global shutter.
    is_observable : callable
        Whether the same pixels show a direction with other cameras and another shutter.
    false_alarm_rate : float
        Lens errors less probable than this rate are excluded. A flow that noise explains at this
        rate does not contradict a rotation.

    Returns
    -------
    RelativePose
        The pose with a wider covariance. The pose is unchanged if the cameras are exact or the
        status is FAILED.
    """
    is_exact = shutter is None or shutter.sigma == shutter.angular_prior_sigma == 0.0
    if pose.status is PoseStatus.FAILED or (
        is_exact and all(v.camera.uncertainty is None for v in (view0, view1))
    ):
        return pose
    assert pose.rotation_cam1_from_cam0 is not None
    theta = so3.log(pose.rotation_cam1_from_cam0)
    inliers = np.flatnonzero(pose.labels != TrackLabel.OUTLIER)
    inliers = inliers[:: max(-(-len(inliers) // LENS_INLIERS), 1)]
    lenses = _Lenses.of(view0.select(inliers), view1.select(inliers), shutter, inliers, theta)
    rays = lenses.rays()
    if pose.status is PoseStatus.OK:
        errors = _explained_by_a_rotation(lenses, rays, pose, false_alarm_rate)
        if errors is not None and not is_observable(*lenses.at(errors)):
            pose = _without_direction(pose)
    by_lens = _sensitivity(pose, *rays)
    spread = by_lens @ by_lens.T
    if pose.covariance is not None:
        return with_covariance(pose, pose.covariance + spread)
    assert pose.rotation_covariance is not None
    return replace(pose, rotation_covariance=pose.rotation_covariance + spread)


class _Rays(NamedTuple):
    """Unit rays (N, 3), and derivatives of the rays by the pixel (N, 3, 2) and ``z`` (N, 3, r)."""

    rays: np.ndarray
    by_pixel: np.ndarray
    by_lens: np.ndarray


class _Lenses(NamedTuple):
    """The rays of both views as functions of ``z`` (r,), the errors in units of one sigma.

    The first elements of ``z`` are errors of the lenses. ``factors`` (P, r) map these errors to the
    parameters of ``camera.refinable``. The last four elements of ``z`` are the error of the
    read-out time and the errors of the derivative of the angular velocity. The ``shutter`` undoes
    the rotation of each row, a share of the rotation vector ``theta``. ``rows`` selects the matches
    of the shutter.
    """

    views: tuple[View, View]
    factors: tuple[np.ndarray, np.ndarray]
    shutter: Shutter | None
    rows: np.ndarray
    theta: np.ndarray

    @classmethod
    def of(
        cls, view0: View, view1: View, shutter: Shutter | None, rows: np.ndarray, theta: np.ndarray
    ) -> _Lenses:
        """Lenses of two views, which share all errors if the two cameras are the same object.

        The errors of two different cameras are independent.
        """
        first = second = view0.camera.parameter_factor
        if view0.camera is not view1.camera and view0.camera != view1.camera:
            second = view1.camera.parameter_factor
            r0, r1 = first.shape[1], second.shape[1]
            first, second = np.pad(first, ((0, 0), (0, r1))), np.pad(second, ((0, 0), (r0, 0)))
        return cls((view0, view1), (first, second), shutter, rows, theta)

    @property
    def size(self) -> int:
        """Number of errors."""
        return self.factors[0].shape[1] + SHUTTER_ERRORS

    def rays(self, z: np.ndarray | None = None) -> tuple[_Rays, _Rays]:
        """Rays of both images through the given lenses, or through lenses with the errors ``z``."""
        views, shutter = self.views, self.shutter
        if z is not None:
            *cameras, shutter = self.at(z)
            views = tuple(v.through(c) for v, c in zip(views, cameras, strict=True))
        first, second = (
            _rays_of(view, factor) for view, factor in zip(views, self.factors, strict=True)
        )
        if shutter is None:
            return first, second
        shutter = shutter.select(self.rows)
        return _unrolled(first, 0, shutter, self.theta), _unrolled(second, 1, shutter, self.theta)

    def at(self, z: np.ndarray) -> tuple[Camera, Camera, Shutter | None]:
        """Exact cameras with the lens errors ``z``.

        The errors are halved until the parameters of the lens are valid.
        """
        shutter = self.shutter
        if shutter is not None:
            readout, derivative = float(z[-SHUTTER_ERRORS]), z[1 - SHUTTER_ERRORS :]
            shutter = shutter._replace(
                share=shutter.share + readout * shutter.sigma,
                derivative=shutter.derivative + derivative * shutter.angular_prior_sigma,
            )
        (camera0, camera1), (factor0, factor1) = (v.camera for v in self.views), self.factors
        of_lens = z[:-SHUTTER_ERRORS]
        first = _with_error(camera0, factor0 @ of_lens)
        if camera0 is camera1:
            return first, first, shutter
        return first, _with_error(camera1, factor1 @ of_lens), shutter


def _rays_of(view: View, factor: np.ndarray) -> _Rays:
    """Rays of a view, and derivatives of the rays by the lens errors.

    The derivatives follow from the implicit function theorem, as in
    `CameraModel.unproject_parameter_jacobian`.
    """
    pixel_by_lens = view.camera.refinable.project_parameter_jacobian(view.rays) @ factor
    by_lens = np.zeros((len(view.rays), 3, factor.shape[1] + SHUTTER_ERRORS))
    by_lens[:, :, :-SHUTTER_ERRORS] = -products(view.by_pixel, pixel_by_lens)
    return _Rays(view.rays, view.by_pixel, by_lens)


def _unrolled(rays: _Rays, image: int, shutter: Shutter, theta: np.ndarray) -> _Rays:
    """Rays in the axes of the middle row: the rotation up to the read-out of each row is undone."""
    unrolled, by_pixel = shutter.unrolled(theta, image, rays.rays, rays.by_pixel)
    by_lens = shutter.columns_unrolled(theta, image, rays.by_lens)
    phases = shutter.phases(image)[:, None]
    by_lens[:, :, -SHUTTER_ERRORS] = cross(
        (-shutter.sigma * phases) * shutter.rate(theta, image), unrolled
    )
    if shutter.angular_prior is not None:
        rate = shutter.angular_prior.by_derivative[image] * shutter.angular_prior.sigma
        rotated = -shutter.share * rate * phases[:, :, None] * _crossed_by_axes(unrolled)
        by_lens[:, :, 1 - SHUTTER_ERRORS :] = rotated
    return _Rays(unrolled, by_pixel, by_lens)


def _crossed_by_axes(a: np.ndarray) -> np.ndarray:
    """Columns (N, 3, 3) ``e_k x a`` for the three axes: the derivative of ``Exp(dtheta) a``."""
    return np.ascontiguousarray(cross(IDENTITY, a[:, None]).transpose(0, 2, 1))


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
    """Derivative ``dx/dz`` of the estimate by the errors of the lenses.

    ``x`` is ``[dtheta, dbeta]``, which gives the shape (5, r), or, for a pose without a direction,
    ``dtheta``, which gives the shape (3, r).
    """
    R, t = pose.rotation_cam1_from_cam0, pose.direction_cam1_from_cam0
    assert R is not None
    if t is None:
        flow = _Flow.of(R, rays0, rays1)
        by_x = flow.by_x.reshape(-1, flow.by_x.shape[2])
        weight = np.repeat(1.0 / flow.variance, 2)
        return _solved(by_x[:, :3], by_x[:, 3:], weight)
    assert pose.direction_basis is not None
    a, b = rays0.rays @ R.T, rays1.rays
    # e = b . (t x R a), the residual across the epipolar plane, and its derivatives.
    across0, across1 = cross(b, t), cross(t, a)
    rotated0 = across0 @ R
    by_x = np.hstack([cross(a, across0), cross(a, b) @ pose.direction_basis])
    by_lens = (rotated0[:, None] @ rays0.by_lens + across1[:, None] @ rays1.by_lens)[:, 0]
    variance = _variance(rotated0, rays0) + _variance(across1, rays1)
    return _solved(by_x, by_lens, 1.0 / variance)


def _variance(direction: np.ndarray, rays: _Rays) -> np.ndarray:
    """Variance (N,) of ``direction . ray`` if each pixel coordinate has a variance of 1 px^2."""
    by_pixel = (direction[:, None] @ rays.by_pixel)[:, 0]
    return np.maximum(np.sum(by_pixel**2, axis=1), np.finfo(float).tiny)


def _solved(by_x: np.ndarray, by_lens: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Solution ``-H^-1 sum(w dr/dx dr/dz)`` with ``H = sum(w dr/dx dr/dx)``.

    The solution is zero along directions of ``x`` that the matches do not determine.
    """
    known = np.isfinite(weight) & np.isfinite(by_x).all(axis=1) & np.isfinite(by_lens).all(axis=1)
    weighted = (by_x * weight[:, None])[known]
    return -np.linalg.pinv(weighted.T @ by_x[known], hermitian=True) @ (weighted.T @ by_lens[known])


class _Flow(NamedTuple):
    """Derotated flow: ``b - R a`` in the plane perpendicular to ``b``.

    ``left`` (N, 2) is the flow, and ``by_x`` (N, 2, 3 + r) its derivatives by ``x = [dtheta, dz]``.
    ``variance`` (N,) is the variance of the flow along one direction if each pixel coordinate has a
    variance of 1 px^2.
    """

    left: np.ndarray
    by_x: np.ndarray
    variance: np.ndarray

    @classmethod
    def of(cls, R: np.ndarray, rays0: _Rays, rays1: _Rays) -> _Flow:
        """The flow that remains without the rotation ``R`` (3, 3), camera 1 from camera 0."""
        a, b = rays0.rays @ R.T, rays1.rays
        basis = tangent_basis(b).transpose(0, 2, 1)
        by_lens = rays1.by_lens - R @ rays0.by_lens
        noise = np.sum(rays1.by_pixel**2, axis=(1, 2)) + np.sum(rays0.by_pixel**2, axis=(1, 2))
        return cls(
            left=(basis @ (b - a)[:, :, None])[:, :, 0],
            by_x=products(basis, np.concatenate([-_crossed_by_axes(a), by_lens], axis=2)),
            variance=np.maximum(0.5 * noise, np.finfo(float).tiny),
        )

    def per_sigma(self, noise_px: float) -> tuple[np.ndarray, np.ndarray]:
        """Flow (M, 2) and derivatives (M, 2, 3 + r) in units of the noise.

        M is the number of matches whose rays exist: through a lens with errors, some pixels may
        have no ray.
        """
        scale = 1.0 / (noise_px * np.sqrt(self.variance))
        left, by_x = self.left * scale[:, None], self.by_x * scale[:, None, None]
        exists = np.isfinite(left).all(axis=1) & np.isfinite(by_x).all(axis=(1, 2))
        return (left, by_x) if exists.all() else (left[exists], by_x[exists])


def _explained_by_a_rotation(
    lenses: _Lenses, rays: tuple[_Rays, _Rays], pose: RelativePose, rate: float
) -> np.ndarray | None:
    """Errors of the lenses (r,) with which a rotation explains most of the flow.

    The result is None if most of the matches contradict a rotation through every probable lens. The
    function maximises, by Gauss-Newton, the likelihood of ``dtheta`` and ``z`` times the prior of
    ``z``. The likelihood has heavy tails, because near points also move by the translation. The
    flow is linearised again in each step that is too long for the last linearisation.
    """
    R, noise_px = pose.rotation_cam1_from_cam0, pose.noise_px
    assert R is not None
    assert noise_px is not None
    size = 3 + lenses.size
    prior = np.array([0.0] * 3 + [1.0] * lenses.size)
    farthest2 = float(scipy.special.chdtri(float(lenses.size), rate))
    contradicts2 = float(scipy.special.chdtri(2.0, rate))
    x = x0 = np.zeros(size)  # [dtheta, z], and where the flow is linearised
    flow0, by_x = _Flow.of(R, *rays).per_sigma(noise_px)
    for _ in range(COARSE_STEPS):
        rows, flow = by_x.reshape(-1, size), flow0 + by_x @ (x - x0)
        weight = (STUDENT_FREEDOM + 2.0) / (STUDENT_FREEDOM + np.sum(flow**2, axis=1))
        weighted = rows * np.repeat(weight, 2)[:, None]
        H = weighted.T @ rows + np.diag(prior)
        H += ROUNDING * np.trace(H) * np.eye(size)
        step = -np.linalg.solve(H, weighted.T @ flow.reshape(-1) + prior * x)
        if np.median(np.sum((flow + by_x @ step) ** 2, axis=1)) > contradicts2:
            return None
        x = x + step
        x[3:] *= min(1.0, np.sqrt(farthest2 / max(float(x[3:] @ x[3:]), 1e-300)))
        if float(np.abs(step[3:]).max()) < LENS_CONVERGED_SIGMA:
            break
        moved = np.abs(x - x0)
        if moved[:3].max() > LINEAR_STEP_RAD or moved[3:].max() > LENS_LINEAR_SIGMA:
            R = so3.exp(x[:3]) @ R
            x = x0 = np.concatenate([np.zeros(3), x[3:]])
            flow0, by_x = _Flow.of(R, *lenses.rays(x[3:])).per_sigma(noise_px)
    return x[3:]


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
