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

from farpoint._kernels.compile import AnnouncedCompilation
from farpoint._kernels.constants import COARSE_STEPS
from farpoint._kernels.explained_flow import explain_by_rotation
from farpoint._kernels.lens_errors import (
    RaysWithErrors,
    lens_sensitivity,
    rays_with_errors,
)
from farpoint._kernels.row_rotation import RowMotion
from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.geometry import so3
from farpoint.pose.conclusion import with_covariance
from farpoint.pose.constants import LENS_INLIERS
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
    is_exact = shutter is None or shutter.sigma == 0.0
    if pose.status is PoseStatus.FAILED or (
        is_exact and all(v.camera.uncertainty is None for v in (view0, view1))
    ):
        return pose
    assert pose.rotation_cam1_from_cam0 is not None
    theta = so3.log(pose.rotation_cam1_from_cam0)
    inliers = np.flatnonzero(pose.labels != TrackLabel.OUTLIER)
    inliers = inliers[:: max(-(-len(inliers) // LENS_INLIERS), 1)]
    lenses = _Lenses.of(view0.select(inliers), view1.select(inliers), shutter, inliers, theta)
    with AnnouncedCompilation("lens errors"):
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


class _Lenses(NamedTuple):
    """The rays of both views as functions of ``z`` (r,), the errors in units of one sigma.

    The last element of ``z`` is the error of the read-out time. The other elements are errors of
    the lenses; ``factors`` (P, r - 1) map them to the parameters of ``camera.refinable``.
    ``shutter`` rotates the rays of each row to the axes of the middle row; ``theta`` is the
    rotation vector between the views. ``rows`` are the indices, in ``shutter``, of the matches of
    ``views``.
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
        factors = np.ascontiguousarray(first), np.ascontiguousarray(second)
        return cls((view0, view1), factors, shutter, rows, theta)

    @property
    def size(self) -> int:
        """Number of errors: those of the lenses, and that of the read-out time."""
        return self.factors[0].shape[1] + 1

    def rays(self, z: np.ndarray | None = None) -> tuple[RaysWithErrors, RaysWithErrors]:
        """Rays of both images through the given lenses, or through lenses with the errors ``z``."""
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
        return (
            self._rays_of(0, view0, by_parameters[0], shutter),
            self._rays_of(1, view1, by_parameters[1], shutter),
        )

    def _rays_of(
        self, image: int, view: View, by_parameters: np.ndarray, shutter: Shutter | None
    ) -> RaysWithErrors:
        count = len(view.rays)
        rays = RaysWithErrors(
            np.empty((count, 3)), np.empty((count, 3, 2)), np.empty((count, 3, self.size))
        )
        phases = means = np.zeros(count)
        rows = RowMotion()
        if shutter is not None:
            phases, means = shutter.phases(image)[self.rows], shutter.mean_phases[self.rows]
            rows = shutter.motion(self.theta, image)
        given = view.rays, view.by_pixel, by_parameters, self.factors[image]
        rays_with_errors(*given, phases, means, rows, rays)
        return rays

    def at(self, z: np.ndarray) -> tuple[Camera, Camera, Shutter | None]:
        """Exact cameras with the lens errors ``z``.

        If the parameters of a lens are not valid, the errors of this lens are halved until the
        parameters are valid.
        """
        shutter = self.shutter
        if shutter is not None:
            shutter = shutter._replace(share=shutter.share + float(z[-1]) * shutter.sigma)
        (camera0, camera1), (factor0, factor1) = (v.camera for v in self.views), self.factors
        of_lens = z[:-1]
        first = _with_error(camera0, factor0 @ of_lens)
        if camera0 is camera1:
            return first, first, shutter
        return first, _with_error(camera1, factor1 @ of_lens), shutter


def _with_error(camera: Camera, error: np.ndarray) -> Camera:
    lens = camera.refinable
    given = np.array(list(lens.parameters.values()))
    for _ in range(10):
        try:
            return replace(camera, model=lens.with_parameters(given + error), uncertainty=None)
        except InputError:
            error = 0.5 * error
    return camera.with_uncertainty()


def _sensitivity(pose: RelativePose, rays0: RaysWithErrors, rays1: RaysWithErrors) -> np.ndarray:
    """Derivative ``dx/dz`` of the estimate by the errors of the lenses and of the shutter.

    ``x`` is ``[dtheta, dbeta]``, and the shape is (5, r). For a pose without a direction, ``x`` is
    ``dtheta``, and the shape is (3, r).
    """
    R, t, basis = pose.rotation_cam1_from_cam0, pose.direction_cam1_from_cam0, pose.direction_basis
    assert R is not None
    if t is None or basis is None:
        t, basis = np.zeros(3), np.empty((3, 0))
    by_error = np.empty((3 + basis.shape[1], rays0.by_error.shape[2]))
    lens_sensitivity(R, t, basis, rays0, rays1, by_error)
    return by_error


def _explained_by_a_rotation(
    lenses: _Lenses, rays: tuple[RaysWithErrors, RaysWithErrors], pose: RelativePose, rate: float
) -> np.ndarray | None:
    """Errors of the lenses (r,) with which a rotation explains most of the flow.

    The result is None if more than 50 % of the matches contradict a rotation through every probable
    lens. If a step leaves the range in which the flow is linear, the flow is linearised again.
    """
    assert pose.rotation_cam1_from_cam0 is not None
    assert pose.noise_px is not None
    farthest2 = float(scipy.special.chdtri(float(lenses.size), rate))
    contradicts2 = float(scipy.special.chdtri(2.0, rate))
    R, z, steps = pose.rotation_cam1_from_cam0.copy(), np.zeros(lenses.size), int(COARSE_STEPS)
    while True:
        limits = farthest2, contradicts2, steps
        is_explained, steps = explain_by_rotation(R, *rays, pose.noise_px, *limits, z)
        if not is_explained:
            return None
        if not steps:
            return z
        rays = lenses.rays(z)


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
