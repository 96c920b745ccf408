"""Motion between two views, from pixels, with rolling shutter and uncertain lenses."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from farpoint.camera import Camera
from farpoint.geometry import so3
from farpoint.pose.constants import COS_NEARBY
from farpoint.pose.general_motion import refit_general_motion
from farpoint.pose.lens_uncertainty import View, with_lens_uncertainty
from farpoint.pose.matches import PixelMatches
from farpoint.pose.model_selection import is_clearly_translating, translation_evidence
from farpoint.pose.options import RelativePoseOptions
from farpoint.pose.pure_rotation import fit_pure_rotation
from farpoint.pose.result import RelativePose
from farpoint.pose.rolling import Searched, estimate_rolling, search_rolling
from farpoint.pose.shutter import Shutter, VelocityPrior, shutter_of
from farpoint.pose.track_errors import NO_EARLIER_PAIRS, TrackErrors
from farpoint.pose.two_views import estimate, shows_direction

__all__ = ["Views", "estimate_views", "rough_motion", "search_views"]


class Views(NamedTuple):
    """The arguments of `estimate_relative_pose`.

    If a ``velocity_prior`` is given, the velocity need not be constant. ``track_errors``
    are those of the earlier pairs of a video.
    """

    points0: np.ndarray
    points1: np.ndarray
    camera0: Camera
    camera1: Camera
    covariance0_px2: np.ndarray | None
    covariance1_px2: np.ndarray | None
    readout_s: float | None
    interval_s: float | None
    velocity_prior: VelocityPrior | None = None
    track_errors: TrackErrors = NO_EARLIER_PAIRS

    def shutter(self) -> Shutter | None:
        """The shutter of the views; None for a global shutter."""
        points = self.points0, self.points1
        return shutter_of(
            self.camera0, *points, self.readout_s, self.interval_s, self.velocity_prior
        )

    def pixels(self) -> PixelMatches:
        """The pixels with the rays of the cameras."""
        return PixelMatches.of(*self[:6])


def estimate_views(
    views: Views,
    options: RelativePoseOptions,
    seed: int,
    searched: Searched | None = None,
) -> RelativePose:
    """The motion between two views.

    If a motion ``searched`` from the same matches is given, there is no new search. The pixels of
    ``views`` may differ from those of the earlier search by a correction for perspective.
    """
    shutter = views.shutter()
    pixels, start = views.pixels(), None if searched is None else searched.fit
    errors = views.track_errors
    if shutter is not None and shutter.share != 0.0:
        pose, shutter = estimate_rolling(shutter, pixels, options, seed, searched, errors)
    else:
        tolerance = options.matching_tolerance_px
        pose = estimate(pixels.matches(), tolerance, options, seed, start, errors)

    def is_observable(camera0: Camera, camera1: Camera, shutter: Shutter | None) -> bool:
        """Whether the matches also show a direction with other lenses and another shutter."""
        pixels, undone = views._replace(camera0=camera0, camera1=camera1).pixels(), None
        R = pose.rotation_cam1_from_cam0
        if shutter is not None and R is not None:
            undone = partial(shutter.unrolled, so3.log(R))
        return shows_direction(pixels.matches(undone), pose, options)

    both = (
        View(views.camera0, np.asarray(views.points0), pixels.rays[0], pixels.by_pixel[0]),
        View(views.camera1, np.asarray(views.points1), pixels.rays[1], pixels.by_pixel[1]),
    )
    return with_lens_uncertainty(pose, *both, shutter, is_observable, options.false_alarm_rate)


def search_views(
    views: Views,
    options: RelativePoseOptions,
    seed: int,
    predicted: tuple[np.ndarray, np.ndarray] | None = None,
) -> Searched | None:
    """The motion found by a search, or a likelier motion near the predicted motion.

    ``predicted`` is a rotation and a direction, cam1_from_cam0. With a rolling shutter, the
    predicted motion is returned as ``other`` if the two directions differ (`COS_NEARBY`), and both
    motions are compared after correction of the rows. The result is None for too few matches.
    """
    shutter = views.shutter()
    searched = search_rolling(shutter, views.pixels(), options, seed)
    if searched is None or predicted is None:
        return searched
    fit = searched.fit
    near = fit.at(*(each.copy() for each in predicted))
    if near.direction_cam1_from_cam0 @ fit.direction_cam1_from_cam0 > COS_NEARBY:
        return searched
    # With a rolling shutter, both motions are compared later, after the rows were corrected with
    # the rotation of each motion.
    if shutter is not None and shutter.share != 0.0:
        return searched._replace(other=near)
    near = refit_general_motion(fit.matches, near)
    return searched._replace(fit=near) if near.log_evidence > fit.log_evidence else searched


def rough_motion(
    searched: Searched, options: RelativePoseOptions
) -> tuple[np.ndarray, np.ndarray | None]:
    """Rotation and direction, cam1_from_cam0, of a motion found by a search.

    If the matches do not show a translation, the result is the pure rotation, and no direction.
    """
    fit = searched.fit
    if is_clearly_translating(fit):
        return fit.R_cam1_from_cam0, fit.direction_cam1_from_cam0
    tolerance = options.matching_tolerance_px
    pure_rotation = fit_pure_rotation(fit.matches, fit.far_rotation_cam1_from_cam0, tolerance)
    if translation_evidence(fit.matches, fit, pure_rotation, options.false_alarm_rate) >= 1.0:
        return fit.R_cam1_from_cam0, fit.direction_cam1_from_cam0
    return pure_rotation.R_cam1_from_cam0, None
