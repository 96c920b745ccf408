"""Maximum-likelihood refinement of a general motion by all matches, with labels and covariance."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.arrays import copy
from farpoint._kernels.compile import kernel, step_kernel
from farpoint._kernels.constants import (
    ALTERNATIONS,
    COARSE_TOLERANCE,
    FINE_TOLERANCE,
    GATE_SIGMA,
    LANES,
    MAX_ITERATIONS,
    MAX_SEARCHED,
    MIN_SIGNAL,
    PANEL,
    SHORT_TAIL,
)
from farpoint._kernels.covariance import (
    MEASURED_FLOW,
    SHRUNK_FLOW,
    covariance_here,
    step_with_shrunk_flow,
)
from farpoint._kernels.evidence import count_beyond_rotation, label_matches
from farpoint._kernels.hypothesis_comparison import laplace_factor
from farpoint._kernels.likelihood import evaluate_residuals
from farpoint._kernels.mixture import mean_variance
from farpoint._kernels.pairs import take_pairs
from farpoint._kernels.parallax_noise import scale_noise_with_parallax
from farpoint._kernels.parallax_prior import fit_parallax_prior
from farpoint._kernels.pose import LinearisationPoint, PackedMatches, Pose
from farpoint._kernels.refinement import refine_pose

__all__ = [
    "MotionBuffers",
    "MotionSummary",
    "evenly_drawn",
    "refine_and_evaluate",
    "refine_motion",
    "searched_matches",
]


class MotionSummary(NamedTuple):
    """Numbers that summarise a refined motion."""

    cost: float
    """Negative log likelihood."""
    laplace_factor: float
    """Result of `hypothesis_comparison.laplace_factor`."""
    agreeing: int
    """Number of matches that are not outliers."""
    sign_log_odds: float
    """Log odds of the direction against the opposite direction."""
    log_odds: float
    """Log odds of the motion against the hypothesis that all matches are outliers."""
    beyond_rotation: int
    """First result of `evidence.count_beyond_rotation`, for the matches used in the search."""
    supporting: int
    """Number of inliers among the matches used in the search."""
    has_shrunk_flow: bool
    """Whether the covariance was computed with shrunk flow (BLUP)."""
    shows_direction: bool
    """Whether the share of signal in the flow is large enough for a direction; see
    `refine_motion`."""
    scales_with_parallax: bool
    """Whether noise that scales with parallax was found significant."""


class MotionBuffers(NamedTuple):
    """Output buffers for the general motion of N matches."""

    R_far: np.ndarray
    """(3, 3) rotation of the far matches, cam1_from_cam0."""
    R: np.ndarray
    """(3, 3) rotation cam1_from_cam0."""
    t: np.ndarray
    """(3,) direction cam1_from_cam0."""
    mixture: np.ndarray
    """(4,) noise parameters; see `pose.Pose`."""
    per_match: np.ndarray
    """(4, at least N) per-match table: prior by the parallax density, and residual, parallax and
    inlier probability by `likelihood.evaluate_residuals`."""
    labels: np.ndarray
    """(N,) labels; see `evidence.label_matches`."""
    covariance: np.ndarray
    """(5, 5) covariance of rotation and direction, rad^2; see `covariance.covariance_here`."""
    R_secondary: np.ndarray
    """(3, 3) rotation of the secondary mode, whose direction differs, if the search found one."""
    t_secondary: np.ndarray
    """(3,) direction of the secondary mode."""
    scaled_pairs: np.ndarray
    """Panels of the matches with noise that scales with parallax, if the scaling is significant."""


@kernel
def evenly_drawn(pairs: np.ndarray, count: int) -> np.ndarray:
    """Panels of `MAX_SEARCHED` evenly spaced matches among the ``count`` matches."""
    rows, taken = np.empty(MAX_SEARCHED, np.int64), np.empty(MAX_SEARCHED // LANES * PANEL)
    for j in range(MAX_SEARCHED):
        rows[j] = j * count // MAX_SEARCHED
    take_pairs(pairs, rows, taken)
    return taken


@step_kernel
def searched_matches(some: np.ndarray, matches: PackedMatches) -> PackedMatches:
    """Matches for the search: without a prior of the parallax, and with the short tail."""
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
    """Prior 1 for each match, 0 for filler."""
    for i in range(prior.size):
        prior[i] = 1.0 if i < count else 0.0


def refine_motion(
    matches: PackedMatches, least_signal: float, buffers: MotionBuffers
) -> MotionSummary:
    """Refine a motion by all matches, with the prior of their parallax, and evaluate the result.

    ``matches.prior`` must be the first row of ``buffers.per_match``. The motion shows a direction
    in two cases. Either, along every axis of the pose, at least a share `MIN_SIGNAL` of the
    Gauss-Newton matrix with measured flow remains after the part that is due to noise is
    subtracted. Or, along every axis, at least a share ``least_signal`` of the Gauss-Newton matrix
    with shrunk flow remains.
    """
    return refine_and_evaluate(searched_pairs(matches), matches, least_signal, buffers)


def searched_pairs(matches: PackedMatches) -> np.ndarray:
    """Panels of the matches that the search uses."""
    few = matches.total <= MAX_SEARCHED
    return matches.pairs if few else evenly_drawn(matches.pairs, matches.total)


def refine_and_evaluate(
    some: np.ndarray, matches: PackedMatches, least_signal: float, buffers: MotionBuffers
) -> MotionSummary:
    """Do the work of `refine_motion`, given the panels of `searched_pairs`."""
    cost, laplace, inliers, scales_with_parallax = _refine_with_noise_model(matches, buffers)
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
    shrunk_flow, shows = _estimate_covariance(point, inliers, least_signal, buffers)
    per_match, count = buffers.per_match, matches.total
    agreeing, sign_log_odds, log_odds, beyond, supporting = _label_and_count(
        some, count, buffers.R, buffers.R_far, buffers.mixture, per_match, buffers.labels
    )
    return MotionSummary(
        cost=cost,
        laplace_factor=laplace,
        agreeing=agreeing,
        sign_log_odds=sign_log_odds,
        log_odds=log_odds,
        beyond_rotation=beyond,
        supporting=supporting,
        has_shrunk_flow=shrunk_flow,
        shows_direction=shows,
        scales_with_parallax=scales_with_parallax,
    )


@kernel
def _refine_with_noise_model(
    matches: PackedMatches, buffers: MotionBuffers
) -> tuple[float, float, float, bool]:
    """Refine the pose twice: to a coarse tolerance, then to a fine tolerance.

    If the coarse refinement shows that the noise scales with parallax, the fine refinement uses
    noise that scales with parallax. The function returns the cost, the
    `hypothesis_comparison.laplace_factor`, the expected number of inliers, and whether the noise
    scales with parallax.
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
    """Label all matches, and count the searched matches that contradict a rotation.

    The function returns the results of `evidence.label_matches` and
    `evidence.count_beyond_rotation`.
    """
    inlier = per_match[3]
    agreeing, sign_log_odds, log_odds = label_matches(
        per_match[2], inlier, math.sqrt(mixture[0]), mixture[1], labels
    )
    prior = np.empty(some.size // PANEL * LANES)
    total = min(count, MAX_SEARCHED)
    for j in range(prior.size):
        prior[j] = 1.0 if j < total and inlier[j * count // total] > 0.5 else 0.0
    # Twice `GATE_SIGMA`: the noise sigma is that of the general motion. The noise sigma of a
    # rotation would be larger, because the general motion takes a part of the flow as translation.
    distance = 2.0 * GATE_SIGMA * math.sqrt(mean_variance(mixture[0], mixture[2]))
    beyond, supporting = count_beyond_rotation(some, prior, R, R_far, distance)
    return agreeing, sign_log_odds, log_odds, beyond, supporting


@step_kernel
def _with_noise(matches: PackedMatches, pairs: np.ndarray) -> PackedMatches:
    """The matches with other panels, ``pairs``, which have other noise."""
    total, half_width, long_tail, prior, odds = (
        matches.total,
        matches.outlier_half_width,
        matches.long_tail,
        matches.prior,
        matches.odds,
    )
    min_variance, max_variance, soft_cheirality = (
        matches.min_variance,
        matches.max_variance,
        matches.soft_cheirality,
    )
    return PackedMatches(
        pairs,
        prior,
        odds,
        total,
        half_width,
        long_tail,
        min_variance,
        max_variance,
        soft_cheirality,
    )


@step_kernel
def _evaluate_residuals(matches: PackedMatches, buffers: MotionBuffers) -> None:
    """Write the results of `likelihood.evaluate_residuals` to the per-match table."""
    per_match = buffers.per_match
    evaluate_residuals(
        _linearisation_point(matches, buffers), per_match[1], per_match[2], per_match[3]
    )


@step_kernel
def _linearisation_point(matches: PackedMatches, buffers: MotionBuffers) -> LinearisationPoint:
    """Linearisation point of the matches at the current pose."""
    half_width, long_tail = matches.outlier_half_width, matches.long_tail
    return LinearisationPoint(
        matches.pairs, matches.prior, buffers.R, buffers.t, buffers.mixture, half_width, long_tail
    )


@step_kernel
def _refine(
    matches: PackedMatches, precision: float, buffers: MotionBuffers, normal: np.ndarray
) -> float:
    """Refine a pose by `refinement.refine_pose`, and update the prior of the parallax in turn.

    The two steps are repeated, up to `ALTERNATIONS` times, as long as inliers lie beyond the end of
    the prior, where the prior is close to 0.
    """
    pose = Pose(buffers.R, buffers.t, buffers.mixture, normal, np.empty(1))
    for _ in range(ALTERNATIONS):
        end = _update_prior(matches, buffers)
        refine_pose(matches, precision, MAX_ITERATIONS, pose)
        _evaluate_residuals(matches, buffers)
        if not _beyond(end, buffers.per_match[2], buffers.per_match[3]):
            break
    return pose.cost[0]


@step_kernel
def _update_prior(matches: PackedMatches, buffers: MotionBuffers) -> float:
    """Fit the prior by `parallax_prior.fit_parallax_prior`, starting from a uniform prior.

    The prior is multiplied by the odds of the matches.
    """
    prior, odds = matches.prior, matches.odds
    copy(odds, prior)
    _evaluate_residuals(matches, buffers)
    parallax, inlier, sigma = (
        buffers.per_match[2],
        buffers.per_match[3],
        math.sqrt(buffers.mixture[0]),
    )
    end = fit_parallax_prior(
        parallax, inlier, matches.total, sigma, matches.outlier_half_width, prior
    )
    for i in range(odds.size):
        prior[i] *= odds[i]
    return end


@step_kernel
def _beyond(end: float, parallax: np.ndarray, inlier: np.ndarray) -> int:
    """Number of inliers with a parallax beyond the end of the prior."""
    count = 0
    for i in range(inlier.size):
        count += 1 if inlier[i] > 0.5 and parallax[i] > end else 0
    return count


def _estimate_covariance(
    point: LinearisationPoint, inliers: float, least_signal: float, buffers: MotionBuffers
) -> tuple[bool, bool]:
    """Covariance of the pose, computed with shrunk flow if much of the flow is noise.

    The flow is shrunk if, along some axis, less than a share `MIN_SIGNAL` of the Gauss-Newton
    matrix remains after the part that is due to noise is subtracted. In this case the pose also
    moves by one step of the normal equations with shrunk flow. The function returns whether the
    flow was shrunk, and whether the motion shows a direction (`refine_motion`).
    """
    if covariance_here(point, inliers, MEASURED_FLOW, MIN_SIGNAL, buffers.covariance):
        return False, True
    step_with_shrunk_flow(point)
    evaluate_residuals(point, buffers.per_match[1], buffers.per_match[2], buffers.per_match[3])
    return True, covariance_here(point, inliers, SHRUNK_FLOW, least_signal, buffers.covariance)
