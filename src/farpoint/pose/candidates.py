"""Candidate motions in addition to the result of the search, and the choice of the likeliest.

The search compares motions by a part of the matches and by residuals only. The result of the search
may be a local maximum if nearly all points are far, if the noise is large, or if the residuals of
neighbours are correlated. In these cases further candidates come from the flow of rejected matches,
the secondary modes of the search, the rotation of the far points, and a search with a bounded noise
scale. Each candidate is refined by the likelihood of all matches. The likeliest candidate replaces
the result of the search if the log likelihood of the candidate is larger by a margin.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from operator import attrgetter

import numpy as np

from farpoint._kernels.constants import GATE_SIGMA
from farpoint._kernels.search import search_direction
from farpoint.pose.constants import (
    CANDIDATE_SAMPLES,
    CHANCE_DIRECTIONS,
    CLEAR_MARGIN,
    LARGE_NOISE_RATIO,
    MIN_REJECTED,
    REJECTED_TOLERANCE_RATIO,
)
from farpoint.pose.far_rotation import far_rotation
from farpoint.pose.general_motion import (
    GeneralMotionFit,
    fit_with_bounded_noise,
    refit_general_motion,
)
from farpoint.pose.matches import Matches
from farpoint.pose.model_selection import is_consensus
from farpoint.pose.options import RelativePoseOptions
from farpoint.pose.two_motions import is_correlated

__all__ = ["likeliest_motion"]


def likeliest_motion(
    matches: Matches,
    fit: GeneralMotionFit,
    tolerance: float,
    options: RelativePoseOptions,
    state: np.ndarray,
) -> GeneralMotionFit:
    """The given fit, or a candidate motion that is clearly likelier.

    If the noise is large, the likeliest other candidate becomes ``candidate_mode`` of the fit.
    """
    is_noisy = fit.noise.sigma >= LARGE_NOISE_RATIO * tolerance
    starts = [*_from_rejected(matches, fit, tolerance, state)]
    if is_noisy or is_correlated(fit, tolerance):
        starts += _with_bounded_noise(matches, fit, tolerance, options, state)
        starts += _from_far_points(matches, fit, tolerance, state)
    if not starts:
        return fit
    others = (refit_general_motion(matches, start) for start in starts)
    found = max(others, key=attrgetter("log_likelihood"))
    if _is_clearly_likelier(found, fit):
        return found
    if not is_noisy:
        return fit
    behind = max(fit.log_likelihood - found.log_likelihood, 0.0)
    other = found.R_cam1_from_cam0, found.direction_cam1_from_cam0, behind
    return replace(fit, candidate_mode=other)


def _is_clearly_likelier(fit: GeneralMotionFit, other: GeneralMotionFit) -> bool:
    """Whether the first motion is likelier than the second by the margin of candidates."""
    margin = 2.0 * CLEAR_MARGIN if fit.has_shrunk_flow else CLEAR_MARGIN
    return fit.log_likelihood - other.log_likelihood > margin * other.matches.misspecification


def _from_rejected(
    matches: Matches, fit: GeneralMotionFit, tolerance: float, state: np.ndarray
) -> Iterator[GeneralMotionFit]:
    """Candidate with the direction towards which rejected matches flow.

    There is such a candidate only if the translational flow of the fit is mostly noise. If nearly
    all points are far, a rotation explains the flow of most matches, and the few near points are
    rejected.
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
    """Best motion of a search whose noise is bounded by its initial value, and the secondary modes
    of this search and of the fit.
    """
    found = fit_with_bounded_noise(
        matches, (tolerance / GATE_SIGMA) ** 2, CANDIDATE_SAMPLES, tolerance, options, state
    )
    yield found
    yield from (
        fit.at(*mode) for mode in (fit.secondary_mode, found.secondary_mode) if mode is not None
    )


def _from_far_points(
    matches: Matches, fit: GeneralMotionFit, tolerance: float, state: np.ndarray
) -> Iterator[GeneralMotionFit]:
    """Candidate by the closed form of 2008.

    The rotation is that of the far points. The direction is the epipole of the near points' flow.
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
