"""The method on one screen: rotation from far rays, direction of travel from the flow that remains,
both refined together, and a verdict on what the matches can tell.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from farpoint._kernels.compile import AnnouncedCompilation
from farpoint._kernels.motion import fit_motion
from farpoint.errors import InputError
from farpoint.pose.as_motion import conclude_motion
from farpoint.pose.as_turn import conclude_turn
from farpoint.pose.candidates import likeliest_motion
from farpoint.pose.closed_form import estimate_closed_form
from farpoint.pose.conclusion import Course, failed_pose
from farpoint.pose.far_rotation import far_rotation
from farpoint.pose.matches import Matches
from farpoint.pose.moving_fit import MovingFit, fit_moving, refit_moving
from farpoint.pose.neighbours import doubt_where_alike
from farpoint.pose.noise_floor import noise_floor
from farpoint.pose.options import RelativePoseOptions
from farpoint.pose.result import RelativePose
from farpoint.pose.turning_fit import turning_when_asked
from farpoint.pose.two_motions import CORRELATED, dominant_motion, without_stationary
from farpoint.pose.verdict import is_plainly_translating, shown_translation

__all__ = ["estimate", "search"]

# Five matches fix a motion; a consensus needs a few more that could have disagreed.
MIN_MATCHES = 8


def search(matches: Matches, options: RelativePoseOptions, seed: int) -> MovingFit | None:
    """The motion that the search finds; None of too few matches."""
    if len(matches) < MIN_MATCHES:
        return None
    with AnnouncedCompilation(fit_motion):
        return fit_moving(matches, options.matching_tolerance_px, options, _random_state(seed))


def estimate(
    matches: Matches,
    tolerance: float,
    options: RelativePoseOptions,
    seed: int,
    start: MovingFit | None = None,
) -> RelativePose:
    """The motion behind matches, without a search where one has led to a ``start``."""
    course = Course()
    if len(matches) < MIN_MATCHES:
        return failed_pose(
            f"Too few matches: {len(matches)} usable of {matches.total} given, "
            f"at least {MIN_MATCHES} are needed.",
            matches.total,
            course,
        )
    with AnnouncedCompilation(fit_motion):
        return _find(matches, tolerance, options, _random_state(seed), course, start)


def _find(
    matches: Matches,
    tolerance: float,
    options: RelativePoseOptions,
    state: np.ndarray,
    course: Course,
    start: MovingFit | None,
) -> RelativePose:
    if not options.refine:
        rotation = far_rotation(matches, tolerance, state)
        return estimate_closed_form(matches, rotation, tolerance, options, state, course)
    if start is None:
        moving = fit_moving(matches, tolerance, options, state)
    else:
        moving = refit_moving(matches, start)
    course.iterations = moving.iterations
    course.lap("search_s")
    floor = noise_floor(matches, moving)
    if floor and matches.told is not None:
        matches = matches.told.with_floor(floor)
        # What the search made of a plane, it did with noise that was told wrong.
        moving = replace(refit_moving(matches, moving), is_planar=True)
        course.lap("refinement_s")
    moving = likeliest_motion(matches, moving, tolerance, options, state)
    given = len(matches)
    matches, moving = without_stationary(matches, moving, tolerance, options, state)
    if len(matches) < given:
        course.remark(
            f"{given - len(matches)} matches stand still in the image: they go along with the "
            "camera, as dirt on its lens does."
        )
    moving = dominant_motion(matches, moving, tolerance, options, state)
    if max(moving.coherence, moving.between) > CORRELATED:
        course.remark(
            "Residuals of neighbouring matches are correlated: lens model, rolling shutter, moving "
            "objects or repeated structure."
        )
    if options.count_sharing:
        matches, moving = doubt_where_alike(matches, moving)
        course.sharing = matches.sharing
    turned = turning_when_asked(matches, moving.far_rotation_cam1_from_cam0, tolerance)
    if is_plainly_translating(moving):
        return conclude_motion(matches, moving, turned, options, course)
    shown = shown_translation(matches, moving, turned(), options.false_alarm_rate)
    if shown >= 1.0:
        return conclude_motion(matches, moving, turned, options, course)
    return conclude_turn(matches, turned(), moving, shown, options, course)


def _random_state(seed: int) -> np.ndarray:
    if not isinstance(seed, (int, np.integer)):
        raise InputError(f"expected a whole number, got {seed!r}", field="seed")
    return np.array([int(seed) % 2**64], np.uint64)
