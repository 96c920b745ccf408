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

from farpoint._kernels.constants import (
    COARSE_STEPS,
    LINEAR_STEP_RAD,
    ROUNDING,
    STUDENT_FREEDOM,
)
from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.geometry import so3
from farpoint.geometry.vectors import cross, products
from farpoint.pose.conclusion import with_covariance
from farpoint.pose.constants import (
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
        Significance level of two chi-squared tests. Lens errors whose p-value is below this rate
        are excluded. A match contradicts a rotation if the p-value of the flow that the rotation
        leaves is below this rate.

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
    """Unit rays (N, 3), with derivatives by the pixel (N, 3, 2) and by the errors (N, 3, r).

    The errors are ``z`` of `_Lenses`.
    """

    rays: np.ndarray
    by_pixel: np.ndarray
    by_lens: np.ndarray


class _Lenses(NamedTuple):
    """The rays of both views as functions of ``z`` (r,), the errors in units of one sigma.

    The last four elements of ``z`` are the errors of the read-out time (1) and of the derivative of
    the angular velocity (3). The other elements are errors of the lenses; ``factors`` (P, r - 4)
    map them to the parameters of ``camera.refinable``. ``shutter`` rotates the rays of each row to
    the axes of the middle row; ``theta`` is the rotation vector between the views. ``rows`` are the
    indices, in ``shutter``, of the matches of ``views``.
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
        """Lenses of two views, which share all errors if the two cameras are the same.

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
        """Rays of both images through the given lenses, or through lenses with the errors ``z``.

        The derivatives by the lens follow from the implicit function theorem, as in
        `CameraModel.unproject_parameter_jacobian`.
        """
        (view0, view1), shutter = self.views, self.shutter
        if z is not None:
            camera0, camera1, shutter = self.at(z)
            view0, view1 = view0.through(camera0), view1.through(camera1)
        if view0.camera is view1.camera:  # both images in one call
            count, both = len(view0.rays), np.concatenate((view0.rays, view1.rays))
            by_both = view0.camera.refinable.project_parameter_jacobian(both)
            by_parameters = by_both[:count], by_both[count:]
        else:
            by_parameters = tuple(
                view.camera.refinable.project_parameter_jacobian(view.rays)
                for view in (view0, view1)
            )
        first = _by_lens(view0, by_parameters[0], self.factors[0])
        second = _by_lens(view1, by_parameters[1], self.factors[1])
        if shutter is None:
            return first, second
        shutter = shutter.select(self.rows)
        return _unrolled(first, 0, shutter, self.theta), _unrolled(second, 1, shutter, self.theta)

    def at(self, z: np.ndarray) -> tuple[Camera, Camera, Shutter | None]:
        """Exact cameras with the lens errors ``z``.

        If the parameters of a lens are not valid, the errors of this lens are halved until the
        parameters are valid.
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


def _by_lens(view: View, by_parameters: np.ndarray, factor: np.ndarray) -> _Rays:
    """Rays of a view, and derivatives of the rays by the lens errors."""
    size, (count, _, parameters) = factor.shape[1], by_parameters.shape
    pixel_by_lens = (by_parameters.reshape(-1, parameters) @ factor).reshape(count, 2, size)
    by_lens = np.zeros((count, 3, size + SHUTTER_ERRORS))
    by_lens[:, :, :size] = -products(view.by_pixel, pixel_by_lens)
    return _Rays(view.rays, view.by_pixel, by_lens)


def _unrolled(rays: _Rays, image: int, shutter: Shutter, theta: np.ndarray) -> _Rays:
    """Rays in the axes of the middle row: the rotation from this row to each row is undone."""
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
    columns = np.zeros((len(a), 3, 3))
    columns[:, 0, 1], columns[:, 0, 2], columns[:, 1, 2] = a[:, 2], -a[:, 1], a[:, 0]
    columns[:, 1, 0], columns[:, 2, 0], columns[:, 2, 1] = -a[:, 2], a[:, 1], -a[:, 0]
    return columns


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
    """Derivative ``dx/dz`` of the estimate by the errors of the lenses and of the shutter.

    ``x`` is ``[dtheta, dbeta]``, and the shape is (5, r). For a pose without a direction, ``x`` is
    ``dtheta``, and the shape is (3, r).
    """
    R, t = pose.rotation_cam1_from_cam0, pose.direction_cam1_from_cam0
    assert R is not None
    if t is None:
        by_x = _flow(R, rays0, rays1)[1]
        weight = np.repeat(1.0 / _flow_variance(rays0, rays1), 3)
        by_x = by_x.reshape(-1, by_x.shape[2])
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
    exists = np.isfinite(by_x.sum(axis=1) + by_lens.sum(axis=1) + weight)
    if not exists.all():
        by_x, by_lens, weight = by_x[exists], by_lens[exists], weight[exists]
    weighted = by_x * weight[:, None]
    values, axes = np.linalg.eigh(weighted.T @ by_x)
    axes = axes[:, values > ROUNDING * values[-1]]
    values = values[values > ROUNDING * values[-1]]
    return -(axes / values) @ (axes.T @ (weighted.T @ by_lens))


def _flow(R: np.ndarray, rays0: _Rays, rays1: _Rays) -> tuple[np.ndarray, np.ndarray]:
    """Derotated flow ``b - R a`` (N, 3), and its derivatives (N, 3, 3 + r) by ``[dtheta, dz]``.

    To first order in the length of the flow, the flow is perpendicular to ``b``.
    """
    a = rays0.rays @ R.T
    by_x = np.empty((len(a), 3, 3 + rays0.by_lens.shape[2]))
    by_x[:, :, :3] = -_crossed_by_axes(a)
    np.subtract(rays1.by_lens, R @ rays0.by_lens, out=by_x[:, :, 3:])
    return rays1.rays - a, by_x


def _flow_variance(rays0: _Rays, rays1: _Rays) -> np.ndarray:
    """Variance (N,) of the flow along one direction, for a variance of 1 px^2 per coordinate."""
    noise = np.sum(rays1.by_pixel**2, axis=(1, 2)) + np.sum(rays0.by_pixel**2, axis=(1, 2))
    return np.maximum(0.5 * noise, np.finfo(float).tiny)


def _explained_by_a_rotation(
    lenses: _Lenses, rays: tuple[_Rays, _Rays], pose: RelativePose, rate: float
) -> np.ndarray | None:
    """Errors of the lenses (r,) with which a rotation explains most of the flow.

    The result is None if more than 50 % of the matches contradict a rotation through every probable
    lens. The function maximises, by Gauss-Newton, the likelihood of ``dtheta`` and ``z`` times the
    prior of ``z``. The likelihood has heavy tails, because near points also move by the
    translation. If a step leaves the range in which the flow is linear, the flow is linearised
    again.
    """
    R, noise_px = pose.rotation_cam1_from_cam0, pose.noise_px
    assert R is not None
    assert noise_px is not None
    size = 3 + lenses.size
    prior = np.array([0.0] * 3 + [1.0] * lenses.size)
    farthest2 = float(scipy.special.chdtri(float(lenses.size), rate))
    contradicts2 = float(scipy.special.chdtri(2.0, rate))
    x = x0 = np.zeros(size)  # [dtheta, z], and where the flow is linearised
    flow0, by_x = _flow_per_sigma(R, *rays, noise_px)
    for _ in range(COARSE_STEPS):
        rows, flow = by_x.reshape(-1, size), flow0 + by_x @ (x - x0)
        weight = (STUDENT_FREEDOM + 2.0) / (STUDENT_FREEDOM + _squares(flow))
        weighted = rows * np.repeat(weight, 3)[:, None]
        H = weighted.T @ rows + np.diag(prior)
        H += ROUNDING * np.trace(H) * np.eye(size)
        step = -np.linalg.solve(H, weighted.T @ flow.reshape(-1) + prior * x)
        if 2 * np.count_nonzero(_squares(flow + by_x @ step) > contradicts2) > len(flow):
            return None
        x = x + step
        x[3:] *= min(1.0, np.sqrt(farthest2 / max(float(x[3:] @ x[3:]), 1e-300)))
        if float(np.abs(step[3:]).max()) < LENS_CONVERGED_SIGMA:
            break
        moved = np.abs(x - x0)
        if moved[:3].max() > LINEAR_STEP_RAD or moved[3:].max() > LENS_LINEAR_SIGMA:
            R = so3.exp(x[:3]) @ R
            x = x0 = np.concatenate([np.zeros(3), x[3:]])
            flow0, by_x = _flow_per_sigma(R, *lenses.rays(x[3:]), noise_px)
    return x[3:]


def _flow_per_sigma(
    R: np.ndarray, rays0: _Rays, rays1: _Rays, noise_px: float
) -> tuple[np.ndarray, np.ndarray]:
    """`_flow` and its derivatives, divided by the sigma of the flow, for matches with rays.

    Through a lens with errors, some pixels may have no ray; these matches are left out.
    """
    flow, by_x = _flow(R, rays0, rays1)
    scale = 1.0 / (noise_px * np.sqrt(_flow_variance(rays0, rays1)))
    flow, by_x = flow * scale[:, None], by_x * scale[:, None, None]
    exists = np.isfinite(flow.sum(axis=1) + by_x.sum(axis=(1, 2)))
    return (flow, by_x) if exists.all() else (flow[exists], by_x[exists])


def _squares(flow: np.ndarray) -> np.ndarray:
    return np.einsum("ni,ni->n", flow, flow)


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
