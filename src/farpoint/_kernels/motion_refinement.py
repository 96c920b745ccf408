"""A motion that was found, settled by all matches: refined, labelled, and how sure it is."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.compile import kernel, step_kernel
from farpoint._kernels.covariance import (
    MEASURED_FLOW,
    MIN_SIGNAL,
    SHRUNK_FLOW,
    covariance_here,
    step_with_shrunk_flow,
)
from farpoint._kernels.design_effect import correlation_and_design_effect
from farpoint._kernels.evidence import NEAR_SIGMA, count_beyond_rotation, label_matches
from farpoint._kernels.hypothesis_comparison import COARSE_TOLERANCE, laplace_factor
from farpoint._kernels.likelihood import evaluate_residuals
from farpoint._kernels.mixture import SHORT_TAIL, mean_variance
from farpoint._kernels.pairs import LANES, PANEL, take_pairs
from farpoint._kernels.parallax_noise import scale_noise_with_parallax
from farpoint._kernels.parallax_prior import fit_parallax_prior
from farpoint._kernels.pose import LinearisationPoint, PackedMatches, Pose
from farpoint._kernels.refinement import refine_pose

__all__ = [
    "MAX_REFINEMENTS",
    "MAX_SEARCHED",
    "MotionBuffers",
    "MotionSummary",
    "SummaryValues",
    "evenly_drawn",
    "refine_and_evaluate",
    "refine_motion",
    "searched_matches",
]

# The search looks at this many matches: more make it slower, not surer.
MAX_SEARCHED = 160
# Log likelihood to which the result is refined: a thirtieth of a sigma.
FINE_TOLERANCE = 1e-3
MAX_REFINEMENTS = np.int64(20)
# How often what is plausible is asked again, at the pose that it has led to.
MAX_ROUNDS = 4


class MotionSummary(NamedTuple):
    """What all matches say of a motion, in numbers.

    Kernels give them to Python as a plain tuple: to make a record they would run Python, which an
    interrupt may end there, and numba does not look.
    """

    cost: float
    """Negative log likelihood."""
    laplace_factor: float
    """As of `hypothesis_comparison.laplace_factor`."""
    agreeing: int
    """Matches that do not disagree."""
    sign_log_odds: float
    """Of the direction, against its opposite."""
    log_odds: float
    """Of the motion, against all matches wrong."""
    beyond_rotation: int
    """Of the right matches searched, those that no rotation explains."""
    supporting: int
    """Right matches searched."""
    has_shrunk_flow: bool
    """Whether the covariance is by the flow that is predicted."""
    shows_direction: bool
    """Whether enough of that is signal."""
    scales_with_parallax: bool
    """Whether the noise was found to grow with the parallax."""
    residual_correlation: float
    """Correlation of residuals with those of their neighbours."""
    correlation_z: float
    """That over what noise would have."""
    design_effect: float
    """As of `design_effect.correlation_and_design_effect`."""


# What `MotionSummary` is made of.
SummaryValues = tuple[
    float, float, int, float, float, int, int, bool, bool, bool, float, float, float
]


class MotionBuffers(NamedTuple):
    """A motion and what its matches say of it."""

    R_far: np.ndarray
    """(3, 3) rotation of the far matches, cam1_from_cam0."""
    R: np.ndarray
    """(3, 3) rotation cam1_from_cam0."""
    t: np.ndarray
    """(3,) direction cam1_from_cam0."""
    mixture: np.ndarray
    """(4,) as of `pose.Pose`."""
    per_match: np.ndarray
    """(4, at least N) of each match: its prior, by what is plausible of it, and, as of
    `likelihood.evaluate_residuals`, its residual, parallax and chance to be right."""
    labels: np.ndarray
    """(N,) as of `evidence.label_matches`."""
    covariance: np.ndarray
    """(5, 5) of rotation and direction, as of `covariance.covariance_here`."""
    R_close: np.ndarray
    """(3, 3) rotation of the second motion that came near, wherever, if one did."""
    t_close: np.ndarray
    """(3,) its direction."""
    R_secondary: np.ndarray
    """(3, 3) rotation of the motion elsewhere that the search met, if it did."""
    t_secondary: np.ndarray
    """(3,) its direction."""
    scaled_pairs: np.ndarray
    """Panels of the matches with the noise that was found, if it grows with the parallax."""


@kernel
def evenly_drawn(pairs: np.ndarray, count: int) -> np.ndarray:
    """As many of the ``count`` matches as the search looks at."""
    rows, taken = np.empty(MAX_SEARCHED, np.int64), np.empty(MAX_SEARCHED // LANES * PANEL)
    for j in range(MAX_SEARCHED):
        rows[j] = j * count // MAX_SEARCHED
    take_pairs(pairs, rows, taken)
    return taken


@step_kernel
def searched_matches(some: np.ndarray, matches: PackedMatches) -> PackedMatches:
    """Those of the matches, with nothing known of them, and errors without a tail."""
    total = matches.total if matches.total < MAX_SEARCHED else MAX_SEARCHED
    prior = np.empty(some.size // PANEL * LANES)
    _leave_out_none(prior, total)
    half_width, min_variance, max_variance = (
        matches.outlier_half_width,
        matches.min_variance,
        matches.max_variance,
    )
    return PackedMatches(
        some,
        prior,
        total,
        half_width,
        SHORT_TAIL,
        min_variance,
        max_variance,
        matches.soft_cheirality,
    )


@step_kernel
def _leave_out_none(prior: np.ndarray, count: int) -> None:
    """Prior 1 for each match, 0 for those that fill up the panels."""
    for i in range(prior.size):
        prior[i] = 1.0 if i < count else 0.0


def refine_motion(
    matches: PackedMatches, least_signal: float, buffers: MotionBuffers
) -> SummaryValues:
    """Refine a pose by all matches, with what parallax they make plausible, and hear them on it.

    As `refinement.refine_pose`; the prior of ``matches``, the first row of what is ``per_match``,
    receives what is plausible of each. It shows a direction if at least ``least_signal`` of the
    flow is signal.
    """
    return refine_and_evaluate(searched_pairs(matches), matches, least_signal, buffers)


def searched_pairs(matches: PackedMatches) -> np.ndarray:
    """Panels of the matches that the search looks at."""
    few = matches.total <= MAX_SEARCHED
    return matches.pairs if few else evenly_drawn(matches.pairs, matches.total)


def refine_and_evaluate(
    some: np.ndarray, matches: PackedMatches, least_signal: float, buffers: MotionBuffers
) -> SummaryValues:
    """As `refine_motion`, with the panels of `searched_pairs` them."""
    cost, laplace, inlier, scales_with_parallax = _refine_with_noise_model(matches, buffers)
    if scales_with_parallax:
        matches = matches._replace(pairs=buffers.scaled_pairs)
    point = LinearisationPoint(
        matches.pairs,
        matches.prior,
        buffers.R,
        buffers.t,
        buffers.mixture,
        matches.outlier_half_width,
        matches.long_tail,
    )
    shrunk_flow, shows = _estimate_covariance(point, inlier, least_signal, buffers)
    per_match, count = buffers.per_match, matches.total
    evidence = _label_and_count(
        some, count, buffers.R, buffers.R_far, buffers.mixture, per_match, buffers.labels
    )
    sharing = correlation_and_design_effect(
        matches.pairs, per_match[1], per_match[3], count, math.sqrt(buffers.mixture[0])
    )
    return (cost, laplace, *evidence, shrunk_flow, shows, scales_with_parallax, *sharing)


@kernel
def _refine_with_noise_model(
    matches: PackedMatches, buffers: MotionBuffers
) -> tuple[float, float, float, bool]:
    """Refine the pose, and once more when its noise is known.

    Returns its cost, its `hypothesis_comparison.laplace_factor`, the expected number of right matches, and whether
    their noise grows.
    """
    normal, cost, scales_with_parallax = np.empty((6, 6)), 0.0, False
    for precision in (COARSE_TOLERANCE, FINE_TOLERANCE):
        with_noise = _with_noise(
            matches, buffers.scaled_pairs if scales_with_parallax else matches.pairs
        )
        cost = _refine(with_noise, precision, buffers, normal)
        if precision == COARSE_TOLERANCE:
            residual, parallax, inlier = (
                buffers.per_match[1],
                buffers.per_match[2],
                buffers.per_match[3],
            )
            variance, scaled_pairs = buffers.mixture[0], buffers.scaled_pairs
            scales_with_parallax = scale_noise_with_parallax(
                matches.pairs, residual, parallax, inlier, matches.total, variance, scaled_pairs
            )
    total = 0.0
    for i in range(matches.total):
        total += buffers.per_match[3, i]
    return cost, laplace_factor(normal), total, scales_with_parallax


@kernel
def _label_and_count(
    some: np.ndarray,
    count: int,
    R: np.ndarray,
    R_far: np.ndarray,
    mixture: np.ndarray,
    per_match: np.ndarray,
    labels: np.ndarray,
) -> tuple[int, float, float, int, int]:
    """What `evidence.label_matches` returns of all, and `evidence.count_beyond_rotation` of some."""
    inlier = per_match[3]
    agreeing, odds, likelier = label_matches(
        per_match[2], inlier, math.sqrt(mixture[0]), mixture[1], labels
    )
    prior = np.empty(some.size // PANEL * LANES)
    total = min(count, MAX_SEARCHED)
    for j in range(prior.size):
        prior[j] = 1.0 if j < total and inlier[j * count // total] > 0.5 else 0.0
    # A pose may take some of the flow: a match is off a rotation by twice what its noise would do.
    distance = 2.0 * NEAR_SIGMA * math.sqrt(mean_variance(mixture[0], mixture[2]))
    beyond, supporting = count_beyond_rotation(some, prior, R, R_far, distance)
    return agreeing, odds, likelier, beyond, supporting


@step_kernel
def _with_noise(matches: PackedMatches, pairs: np.ndarray) -> PackedMatches:
    """The matches, with the noise of these panels."""
    total, half_width, long_tail, prior = (
        matches.total,
        matches.outlier_half_width,
        matches.long_tail,
        matches.prior,
    )
    min_variance, max_variance, soft_cheirality = (
        matches.min_variance,
        matches.max_variance,
        matches.soft_cheirality,
    )
    return PackedMatches(
        pairs, prior, total, half_width, long_tail, min_variance, max_variance, soft_cheirality
    )


@step_kernel
def _evaluate_residuals(matches: PackedMatches, buffers: MotionBuffers) -> None:
    """As `likelihood.evaluate_residuals`."""
    per_match = buffers.per_match
    evaluate_residuals(
        _linearisation_point(matches, buffers), per_match[1], per_match[2], per_match[3]
    )


@step_kernel
def _linearisation_point(matches: PackedMatches, buffers: MotionBuffers) -> LinearisationPoint:
    """The matches as the pose sees them."""
    half_width, long_tail = matches.outlier_half_width, matches.long_tail
    return LinearisationPoint(
        matches.pairs, matches.prior, buffers.R, buffers.t, buffers.mixture, half_width, long_tail
    )


@step_kernel
def _refine(
    matches: PackedMatches, precision: float, buffers: MotionBuffers, normal: np.ndarray
) -> float:
    """As `refinement.refine_pose`, by what the pose as it was makes plausible of the matches.

    Again where it ends at a pose that some of them made, and from which they lie too far away.
    """
    pose = Pose(buffers.R, buffers.t, buffers.mixture, normal, np.empty(1))
    for _ in range(MAX_ROUNDS):
        end = _update_prior(matches, buffers)
        refine_pose(matches, precision, MAX_REFINEMENTS, pose)
        _evaluate_residuals(matches, buffers)
        if not _beyond(end, buffers.per_match[2], buffers.per_match[3]):
            break
    return pose.cost[0]


@step_kernel
def _update_prior(matches: PackedMatches, buffers: MotionBuffers) -> float:
    """As `parallax_prior.fit_parallax_prior`, of all matches alike."""
    _leave_out_none(matches.prior, matches.total)
    _evaluate_residuals(matches, buffers)
    parallax, inlier, sigma = (
        buffers.per_match[2],
        buffers.per_match[3],
        math.sqrt(buffers.mixture[0]),
    )
    return fit_parallax_prior(
        parallax, inlier, matches.total, sigma, matches.outlier_half_width, matches.prior
    )


@step_kernel
def _beyond(end: float, parallax: np.ndarray, inlier: np.ndarray) -> int:
    """Right matches of more parallax."""
    count = 0
    for i in range(inlier.size):
        count += 1 if inlier[i] > 0.5 and parallax[i] > end else 0
    return count


def _estimate_covariance(
    point: LinearisationPoint, inlier: float, least_signal: float, buffers: MotionBuffers
) -> tuple[bool, bool]:
    """Covariance of the pose; where much of the flow is noise, by predicted flow, as is the pose.

    Returns whether it was predicted, and whether at least so much of it is signal.
    """
    if covariance_here(point, inlier, MEASURED_FLOW, MIN_SIGNAL, buffers.covariance):
        return False, True
    step_with_shrunk_flow(point)
    evaluate_residuals(point, buffers.per_match[1], buffers.per_match[2], buffers.per_match[3])
    return True, covariance_here(point, inlier, SHRUNK_FLOW, least_signal, buffers.covariance)
