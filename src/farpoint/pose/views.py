"""Two views of cameras with their shutter: from pixels to a motion that holds the lens's doubt."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from farpoint.camera import Camera
from farpoint.pose.candidates import CLEAR
from farpoint.pose.lens_uncertainty import View, with_lens_uncertainty
from farpoint.pose.matches import PixelMatches
from farpoint.pose.moving_fit import refit_moving
from farpoint.pose.options import RelativePoseOptions
from farpoint.pose.result import RelativePose
from farpoint.pose.rivals import COS_NEARBY
from farpoint.pose.rolling import Searched, estimate_rolling, search_rolling
from farpoint.pose.shutter import Shutter, Turning, shutter_of
from farpoint.pose.turning_fit import fit_turning
from farpoint.pose.two_views import estimate
from farpoint.pose.verdict import is_plainly_translating, shown_translation

__all__ = ["Views", "estimate_views", "rough_motion", "search_views"]


class Views(NamedTuple):
    """What is given of two views, as of `estimate_relative_pose`.

    Where the ``turning`` is known, velocities need not be constant.
    """

    points0: np.ndarray
    points1: np.ndarray
    camera0: Camera
    camera1: Camera
    covariance0_px2: np.ndarray | None
    covariance1_px2: np.ndarray | None
    readout_s: float | None
    interval_s: float | None
    turning: Turning | None = None

    def shutter(self) -> Shutter | None:
        """The shutter behind them; None where it is global."""
        points = self.points0, self.points1
        return shutter_of(self.camera0, *points, self.readout_s, self.interval_s, self.turning)

    def pixels(self) -> PixelMatches:
        """What the cameras see at the pixels."""
        return PixelMatches.of(*self[:6])


def estimate_views(
    views: Views,
    options: RelativePoseOptions,
    seed: int,
    searched: Searched | None = None,
) -> RelativePose:
    """The motion, without a search where one of the same matches has been made.

    That may be from before their pixels were corrected.
    """

    def by(
        options: RelativePoseOptions, camera0: Camera, camera1: Camera, shutter: Shutter | None
    ) -> RelativePose:
        """The motion through these lenses and this shutter."""
        pixels = views._replace(camera0=camera0, camera1=camera1).pixels()
        if shutter is not None and shutter.share != 0.0:
            return estimate_rolling(shutter, pixels, options, seed, searched)
        start = None if searched is None else searched.fit
        return estimate(pixels.matches(), options.matching_tolerance_px, options, seed, start)

    shutter, cameras = views.shutter(), (views.camera0, views.camera1)
    pose = by(options, *cameras, shutter)
    seen = View(views.points0, views.camera0), View(views.points1, views.camera1)
    undealt = partial(by, replace(options, half_deals=0))
    return with_lens_uncertainty(pose, *seen, shutter, undealt, options.false_alarm_rate)


def search_views(
    views: Views,
    options: RelativePoseOptions,
    seed: int,
    predicted: tuple[np.ndarray, np.ndarray] | None = None,
) -> Searched | None:
    """The motion that a search finds, and the one near a predicted one, if that is another.

    ``predicted`` is a rotation and a direction, cam1_from_cam0. None of too few matches.
    """
    shutter = views.shutter()
    searched = search_rolling(shutter, views.pixels(), options, seed)
    if searched is None or predicted is None:
        return searched
    fit = searched.fit
    near = fit.at(*(each.copy() for each in predicted))
    if near.direction_cam1_from_cam0 @ fit.direction_cam1_from_cam0 > COS_NEARBY:
        return searched
    if shutter is not None:  # which of the two it is their own unrolled rows tell
        return searched._replace(other=near)
    near = refit_moving(fit.matches, near)
    is_likelier = near.log_likelihood > fit.log_likelihood + CLEAR
    return searched._replace(fit=near) if is_likelier else searched


def rough_motion(
    searched: Searched, options: RelativePoseOptions
) -> tuple[np.ndarray, np.ndarray | None]:
    """Rotation, cam1_from_cam0, and direction of a motion that was searched for, if it is shown."""
    fit = searched.fit
    if is_plainly_translating(fit):
        return fit.R_cam1_from_cam0, fit.direction_cam1_from_cam0
    tolerance = options.matching_tolerance_px
    turned = fit_turning(fit.matches, fit.far_rotation_cam1_from_cam0, tolerance)
    if shown_translation(fit.matches, fit, turned, options.false_alarm_rate) >= 1.0:
        return fit.R_cam1_from_cam0, fit.direction_cam1_from_cam0
    return turned.R_cam1_from_cam0, None
