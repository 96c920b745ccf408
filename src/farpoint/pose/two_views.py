"""The whole two-view method.

The rotation comes from far rays, and the direction from the remaining flow. Both are refined
jointly. Tests then decide which quantities are observable.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from farpoint._kernels.compile import AnnouncedCompilation
from farpoint._kernels.constants import MIN_MATCHES
from farpoint.errors import InputError
from farpoint.pose.candidates import candidate_motions
from farpoint.pose.certainty import direction_sigma
from farpoint.pose.closed_form import estimate_closed_form
from farpoint.pose.conclusion import Diagnostics, failed_pose
from farpoint.pose.constants import NOTED_CORRELATION
from farpoint.pose.correlated_residuals import count_residual_correlation
from farpoint.pose.far_rotation import far_rotation
from farpoint.pose.general_motion import (
    GeneralMotionFit,
    fit_general_motion,
    refit_general_motion,
    start_at,
)
from farpoint.pose.general_motion_conclusion import conclude_general_motion
from farpoint.pose.matches import Matches
from farpoint.pose.model_selection import is_clearly_translating, is_vague, translation_evidence
from farpoint.pose.noise_floor import noise_floor
from farpoint.pose.options import RelativePoseOptions
from farpoint.pose.posterior import compare_motions
from farpoint.pose.pure_rotation import fit_pure_rotation, lazy_pure_rotation
from farpoint.pose.pure_rotation_conclusion import conclude_pure_rotation
from farpoint.pose.result import RelativePose
from farpoint.pose.track_errors import NO_EARLIER_PAIRS, TrackErrors
from farpoint.pose.two_motions import explain_by_two

__all__ = ["estimate", "search", "shows_direction"]

CORRELATED = (
    "Residuals of neighbouring matches are correlated: lens model, rolling shutter, moving objects "
    "or repeated structure."
)


def search(matches: Matches, options: RelativePoseOptions, seed: int) -> GeneralMotionFit | None:
    """The motion that the search finds; None for too few matches."""
    if len(matches) < MIN_MATCHES:
        return None
    with AnnouncedCompilation("motion"):
        return fit_general_motion(
            matches, options.matching_tolerance_px, options, _random_state(seed)
        )


def estimate(
    matches: Matches,
    tolerance: float,
    options: RelativePoseOptions,
    seed: int,
    start: GeneralMotionFit | None = None,
    errors: TrackErrors = NO_EARLIER_PAIRS,
) -> RelativePose:
    """The motion of the matches; with a ``start`` from an earlier search there is no new search.

    ``errors`` are those of the tracks in the earlier pairs of a video.
    """
    diagnostics = Diagnostics()
    if len(matches) < MIN_MATCHES:
        return failed_pose(
            f"Too few matches: {len(matches)} usable of {matches.total} given, "
            f"at least {MIN_MATCHES} are needed.",
            matches.total,
            diagnostics,
        )
    with AnnouncedCompilation("motion"):
        return _find(matches, tolerance, options, _random_state(seed), diagnostics, start, errors)


def shows_direction(matches: Matches, pose: RelativePose, options: RelativePoseOptions) -> bool:
    """Whether the matches, seen through another lens, also show a direction.

    The fit of the matches starts from a known ``pose``.
    """
    if len(matches) < MIN_MATCHES:
        return False
    start, rate = start_at(pose), options.false_alarm_rate
    floor = noise_floor(matches, start)
    if floor and matches.given_noise is not None:
        matches = matches.given_noise.with_floor(floor)
    general = refit_general_motion(matches, start)
    sigma = direction_sigma(general.covariance)
    if not general.shows_direction or is_vague(general, sigma, rate):
        return False
    if is_clearly_translating(general):
        return True
    tolerance = options.matching_tolerance_px
    pure_rotation = fit_pure_rotation(matches, general.R_cam1_from_cam0, tolerance)
    return translation_evidence(matches, general, pure_rotation, rate) >= 1.0


def _find(
    matches: Matches,
    tolerance: float,
    options: RelativePoseOptions,
    state: np.ndarray,
    diagnostics: Diagnostics,
    start: GeneralMotionFit | None,
    errors: TrackErrors,
) -> RelativePose:
    if not options.refine:
        rotation = far_rotation(matches, tolerance, state)
        return estimate_closed_form(matches, rotation, tolerance, options, state, diagnostics)
    general = start or fit_general_motion(matches, tolerance, options, state)
    diagnostics.iterations = general.iterations
    diagnostics.time_stage("search_s")
    matches, start = _with_noise_floor(matches, general, start)
    if start is not None:
        general = refit_general_motion(matches, start)
    diagnostics.time_stage("refinement_s")
    two = explain_by_two(matches, general, tolerance, options, state)
    if two is not None:
        matches, general = two.matches, two.fit
        diagnostics.note(two.described())
    diagnostics.residual_correlation = general.neighbours.correlation
    if diagnostics.residual_correlation > NOTED_CORRELATION:
        diagnostics.note(CORRELATED)
    if options.count_sharing:
        matches, general = count_residual_correlation(matches, general)
        diagnostics.design_effect = matches.design_effect
    pure_rotation = lazy_pure_rotation(matches, general.far_rotation_cam1_from_cam0, tolerance)
    candidates = candidate_motions(matches, general, tolerance, options, state)
    rate = options.false_alarm_rate
    posterior = compare_motions(matches, general, candidates, pure_rotation, rate)
    evidence, general = 1.0, posterior.fit
    if not is_clearly_translating(general):
        evidence = translation_evidence(matches, general, pure_rotation(), rate)
    if evidence >= 1.0:
        return conclude_general_motion(
            matches, posterior, pure_rotation, options, diagnostics, errors
        )
    return conclude_pure_rotation(
        matches, pure_rotation(), general, evidence, options, diagnostics, errors
    )


def _with_noise_floor(
    matches: Matches, general: GeneralMotionFit, start: GeneralMotionFit | None
) -> tuple[Matches, GeneralMotionFit | None]:
    """The matches with a noise floor added to the given noise, and the start of a refinement.

    If the noise floor is zero, the matches and the start are returned unchanged.
    """
    floor = noise_floor(matches, general)
    if not floor or matches.given_noise is None:
        return matches, start
    # The search has tested for a plane with noise that lacked the floor. ``is_planar=True`` makes
    # `posterior` repeat the test.
    return matches.given_noise.with_floor(floor), replace(general, is_planar=True)


def _random_state(seed: int) -> np.ndarray:
    if not isinstance(seed, (int, np.integer)):
        raise InputError(f"expected a whole number, got {seed!r}", field="seed")
    return np.array([int(seed) % 2**64], np.uint64)
