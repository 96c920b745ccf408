"""Candidate motions in addition to the result of the search.

The search compares motions by at most `MAX_SEARCHED` matches, and without a prior of the parallax.
The motion that it finds may be only a local maximum if the likelihood has several modes, if nearly
all points are far, if the noise is large, or if the residuals of neighbours are correlated. Each
candidate is the start of a refinement by the likelihood of all matches; `posterior` compares the
refined motions.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from farpoint._kernels.constants import GATE_SIGMA
from farpoint._kernels.search import search_direction
from farpoint.pose.constants import (
    CANDIDATE_SAMPLES,
    CHANCE_DIRECTIONS,
    LARGE_NOISE_RATIO,
    MIN_REJECTED,
    REJECTED_TOLERANCE_RATIO,
)
from farpoint.pose.far_rotation import far_rotation
from farpoint.pose.general_motion import GeneralMotionFit, fit_with_bounded_noise
from farpoint.pose.matches import Matches
from farpoint.pose.model_selection import is_consensus
from farpoint.pose.options import RelativePoseOptions

__all__ = ["candidate_motions"]


def candidate_motions(
    matches: Matches,
    fit: GeneralMotionFit,
    tolerance: float,
    options: RelativePoseOptions,
    state: np.ndarray,
) -> Iterator[GeneralMotionFit]:
    """Starts of refinements that may lead to a motion likelier than ``fit``; usually none."""
    if fit.secondary_mode is not None:
        yield fit.at(*fit.secondary_mode)
    yield from _from_rejected(matches, fit, tolerance, state)
    if fit.noise.sigma >= LARGE_NOISE_RATIO * tolerance:
        yield from _with_bounded_noise(matches, fit, tolerance, options, state)
        yield from _from_far_points(matches, fit, tolerance, state)


def _from_rejected(
    matches: Matches, fit: GeneralMotionFit, tolerance: float, state: np.ndarray
) -> Iterator[GeneralMotionFit]:
    """Candidate with the direction towards which rejected matches flow.

    Rejected matches have an inlier probability below 0.5. If nearly all points are far, a rotation
    explains the flow of most matches, and the few near points are rejected. A direction is
    therefore searched for in the rejected matches, but only if the covariance of ``fit`` was
    computed with shrunk flow. The direction is a candidate only if more rejected matches agree on
    it than by chance.
    """
    rejected = fit.probability < 0.5
    count, within = int(np.count_nonzero(rejected)), REJECTED_TOLERANCE_RATIO * tolerance
    if not fit.has_shrunk_flow or count < MIN_REJECTED:
        return
    t = np.empty(3)
    R, apart = fit.far_rotation_cam1_from_cam0.copy(), matches.select(rejected)
    arguments = apart.pairs, apart.weights(), np.arange(count), within, CANDIDATE_SAMPLES, state
    agreeing = count - int(search_direction(*arguments, R, t) / within**2)
    if is_consensus(agreeing, count, 2, within / matches.outlier_half_width, CHANCE_DIRECTIONS):
        yield fit.at(R, t)


def _with_bounded_noise(
    matches: Matches,
    fit: GeneralMotionFit,
    tolerance: float,
    options: RelativePoseOptions,
    state: np.ndarray,
) -> Iterator[GeneralMotionFit]:
    """Modes of a search with an upper bound of the noise sigma, ``tolerance / GATE_SIGMA``."""
    found = fit_with_bounded_noise(
        matches, (tolerance / GATE_SIGMA) ** 2, CANDIDATE_SAMPLES, tolerance, options, state
    )
    yield found
    if found.secondary_mode is not None:
        yield fit.at(*found.secondary_mode)


def _from_far_points(
    matches: Matches, fit: GeneralMotionFit, tolerance: float, state: np.ndarray
) -> Iterator[GeneralMotionFit]:
    """Candidate with the rotation of the far points and the direction of the other points' flow.

    The direction is the best intersection of the great circles of two matches.
    """
    rotation = far_rotation(matches, tolerance, state)
    others = matches.select(~rotation.consistent)
    if len(others) < MIN_REJECTED:
        return
    R, t = rotation.R_cam1_from_cam0.copy(), np.empty(3)
    arguments = (
        others.pairs,
        others.weights(),
        np.arange(len(others)),
        tolerance,
        CANDIDATE_SAMPLES,
        state,
    )
    search_direction(*arguments, R, t)
    yield fit.at(R, t)
