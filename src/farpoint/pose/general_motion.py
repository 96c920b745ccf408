"""The general motion: rotation and direction of translation with the maximum likelihood.

In the essential-matrix model, a match may lie anywhere along its epipolar line. Inliers have normal
noise of unknown scale with a heavy tail. EM estimates the noise scale and the outlier share
together with the motion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from farpoint._kernels.constants import (
    LANES,
    LN2,
    LONG_TAIL,
    MAX_SEARCHED,
    PANEL,
    REPEATED_WIDTH_RATIO,
    ROUNDING,
    START_REPEATED_SHARE,
    START_TAIL_SHARE,
)
from farpoint._kernels.covariance import covariance_around
from farpoint._kernels.five_rays import SearchBudget
from farpoint._kernels.likelihood import evaluate_residuals
from farpoint._kernels.motion import fit_motion
from farpoint._kernels.motion_refinement import MotionBuffers, MotionSummary, refine_motion
from farpoint._kernels.pairs import packed_length
from farpoint._kernels.pose import LinearisationPoint, PackedMatches, Pose
from farpoint.pose.constants import (
    EFFECTIVE_PER_ROOT,
    IDENTITY,
    LINEAR_DIRECTION_SIGMA,
    MAX_FLOW_NOISE_SHARE,
)
from farpoint.pose.information import positive
from farpoint.pose.matches import Matches
from farpoint.pose.noise import Noise
from farpoint.pose.options import RelativePoseOptions
from farpoint.pose.residual_correlation import ResidualCorrelation
from farpoint.pose.result import RelativePose

__all__ = [
    "GeneralMotionFit",
    "Start",
    "evaluate_matches",
    "fit_general_motion",
    "fit_with_bounded_noise",
    "linearisation_point",
    "log_densities",
    "packed_pose",
    "refit_general_motion",
    "start_at",
]


class Start(NamedTuple):
    """Initial values of a refinement; the fields have the meaning of `GeneralMotionFit`."""

    R_cam1_from_cam0: np.ndarray
    direction_cam1_from_cam0: np.ndarray
    noise: Noise
    far_rotation_cam1_from_cam0: np.ndarray
    iterations: int = 0
    is_planar: bool = False
    secondary_mode: tuple[np.ndarray, np.ndarray] | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class GeneralMotionFit:
    """Rotation and direction of translation, fitted to matches.

    Attributes
    ----------
    R_cam1_from_cam0 : ndarray, shape (3, 3)
    direction_cam1_from_cam0 : ndarray, shape (3,)
    noise : Noise
    matches : Matches
        The matches that were fitted.
    per_match : ndarray, shape (4, at least N)
        Four rows in the format of the kernels: prior by the parallax density, `residual`,
        `parallax` and `probability`.
    labels : ndarray of uint8, shape (N,)
        0 for an outlier, 2 for a match with parallax beyond the noise, 1 for any other match.
    covariance : ndarray, shape (5, 5)
        Covariance of rotation and direction at this pose; infinite if the matches fix no rotation.
    has_shrunk_flow : bool
        Whether the covariance was computed with shrunk flow (BLUP), because much of the flow is
        noise.
    shows_direction : bool
        Whether the share of signal in the flow is large enough for a direction.
    iterations : int
        Number of samples of five matches that the search has drawn.
    is_planar : bool
        Whether the second motion of a plane may have nearly the same likelihood.
    secondary_mode : tuple of ndarray, shapes (3, 3) and (3,), or None
        Rotation and direction, cam1_from_cam0, of another mode that the search found, if any.
    cost : float
        Mean negative log likelihood of a match.
    far_rotation_cam1_from_cam0 : ndarray, shape (3, 3)
        Initial rotation of the search: the rotation of the far points.
    laplace_factor : float
        Negative logarithm of the Laplace (Occam) factor: the logarithm of the likelihood of all
        matches at the mode, minus the logarithm of the likelihood averaged over nearby poses.
    agreeing : int
        Number of matches that are not outliers.
    sign_log_odds : float
        Log odds of the direction against the opposite direction.
    log_odds : float
        Log odds of the motion against the hypothesis that all matches are outliers.
    beyond_rotation, supporting : int
        For the inliers among the matches used in the search: number of inliers that the best of
        three rotations does not explain (`evidence.count_beyond_rotation`), and number of all
        inliers.
    """

    R_cam1_from_cam0: np.ndarray
    direction_cam1_from_cam0: np.ndarray
    noise: Noise
    matches: Matches
    per_match: np.ndarray
    labels: np.ndarray
    covariance: np.ndarray
    has_shrunk_flow: bool
    shows_direction: bool
    iterations: int
    is_planar: bool
    secondary_mode: tuple[np.ndarray, np.ndarray] | None
    cost: float
    far_rotation_cam1_from_cam0: np.ndarray
    laplace_factor: float
    agreeing: int
    sign_log_odds: float
    log_odds: float
    beyond_rotation: int
    supporting: int

    def at(
        self, R_cam1_from_cam0: np.ndarray, direction_cam1_from_cam0: np.ndarray
    ) -> GeneralMotionFit:
        """The start of a refinement from another motion, with the noise of this fit."""
        return replace(
            self,
            R_cam1_from_cam0=R_cam1_from_cam0,
            direction_cam1_from_cam0=direction_cam1_from_cam0,
        )

    @property
    def log_evidence(self) -> float:
        """Logarithm of the averaged likelihood of all matches, plus that of the sign probability.

        The likelihood is averaged over nearby poses (Laplace). The prior of the parallax of a match
        is estimated from the other matches, and matches of one surface are correlated. The
        effective sample size of the prior is therefore ``min(N, 5 sqrt(N))`` for N matches: the sum
        of the log priors is multiplied by ``min(5 / sqrt(N), 1)``.
        """
        n = len(self.matches)
        log_prior = float(self.probability @ np.log(self.per_match[0, :n]))
        redundant = 1.0 - min(EFFECTIVE_PER_ROOT / math.sqrt(n), 1.0)
        sign = -float(np.logaddexp(0.0, -self.sign_log_odds))
        return sign - self.cost * n - self.laplace_factor - redundant * log_prior

    @property
    def sign_probability(self) -> float:
        """Probability of the direction as compared with the opposite direction."""
        return 1.0 / (1.0 + math.exp(-min(max(self.sign_log_odds, -700.0), 700.0)))

    @cached_property
    def neighbours(self) -> ResidualCorrelation:
        """Correlation between the residuals of neighbouring inliers."""
        residual = self.residual / self.noise.sigma
        return ResidualCorrelation.of(self.matches, residual, self.probability)

    @cached_property
    def averaged_covariance(self) -> np.ndarray:
        """Covariance (5, 5) of ``[dtheta, dbeta]``, rad^2, in the `tangent_basis` of the direction.

        The covariance is the sandwich ``H^-1 V H^-1``. H is the Hessian of the expected negative
        log likelihood, and V is the variance of the gradient. H is the Gauss-Newton matrix minus a
        correction: because the depths are also estimated, noise in the flow increases the
        Gauss-Newton matrix like true flow. V is a weighted mean of two matrices: the Gauss-Newton
        matrix, which is correct if the noise model is true, and the scatter of the gradient over
        the matches, which is correct for any noise. The weight of the scatter increases with the
        effective number of matches.

        If the direction is uncertain, H depends on the pose: a small error of the rotation
        lengthens the flow of all matches and increases the information. If the root of the sum of
        the variances of the direction exceeds `LINEAR_DIRECTION_SIGMA`, the covariance is therefore
        averaged over the poses within one sigma.
        """
        covariance = self.covariance
        if LINEAR_DIRECTION_SIGMA**2 < covariance[3, 3] + covariance[4, 4] < math.inf:
            averaged, inliers = np.empty((5, 5)), float(np.add.reduce(self.probability))
            matches, prior = self.matches, self.per_match[0]
            point = linearisation_point(self, matches.outlier_half_width, matches.pairs, prior)
            covariance_around(point, inliers, self.has_shrunk_flow, covariance, averaged)
            covariance = averaged
        return positive(covariance)

    @property
    def residual(self) -> np.ndarray:
        """Sampson residual (N,) of each match, in the unit of the noise sigma."""
        return self.per_match[1, : len(self.matches)]

    @property
    def parallax(self) -> np.ndarray:
        """Signed shift (N,) along the epipolar line, positive towards the direction.

        The shift is measured from the position that the rotation predicts, and is divided by the
        standard deviation of the shift for a noise sigma of 1. The residual across the line is not
        part of the shift.
        """
        return self.per_match[2, : len(self.matches)]

    @property
    def probability(self) -> np.ndarray:
        """Inlier probability (N,) of each match."""
        return self.per_match[3, : len(self.matches)]


def fit_general_motion(
    matches: Matches, tolerance: float, options: RelativePoseOptions, state: np.ndarray
) -> GeneralMotionFit:
    """Maximum-likelihood rotation and direction, by a search that starts from the far rotation.

    The direction of the derotated flow is refined jointly with the rotation. If there are no far
    points, or if a rotation can imitate the parallax, the refined pose may be only a local maximum.
    The refined pose is therefore compared with poses from samples of five matches.
    """
    n = len(matches)
    found = _empty_buffers(n)
    samples = max(options.min_iterations, math.ceil(LN2 * math.comb(n, 5)))
    budget = SearchBudget(
        tolerance=tolerance,
        confidence=options.confidence,
        min_iterations=options.min_iterations,
        max_iterations=min(samples, options.max_iterations),
    )
    iterations, is_planar, has_mode, summary = fit_motion(
        _packed(matches, found), budget, _least_signal(matches), state, found
    )
    mode = (found.R_secondary, found.t_secondary) if has_mode else None
    return _general_motion_fit(matches, iterations, bool(is_planar), mode, found, summary)


def fit_with_bounded_noise(
    matches: Matches,
    variance: float,
    samples: int,
    tolerance: float,
    options: RelativePoseOptions,
    state: np.ndarray,
) -> GeneralMotionFit:
    """`fit_general_motion` of a part of the matches, with a bounded noise scale and few samples.

    ``variance`` is the upper bound of the noise variance, in squared units of the noise sigma.
    ``samples`` is the largest number of samples.
    """
    least, most = (min(n, samples) for n in (options.min_iterations, options.max_iterations))
    budget = replace(options, min_iterations=least, max_iterations=most)
    part = matches.subsample(MAX_SEARCHED).with_noise_up_to(variance)
    return fit_general_motion(part, tolerance, budget, state)


def refit_general_motion(matches: Matches, fit: GeneralMotionFit | Start) -> GeneralMotionFit:
    """Refine an earlier fit with the same matches.

    The noise model of the matches may differ from that of the earlier fit.
    """
    found = _empty_buffers(len(matches))._replace(
        R_far=fit.far_rotation_cam1_from_cam0,
        R=fit.R_cam1_from_cam0.copy(),
        t=fit.direction_cam1_from_cam0.copy(),
        mixture=fit.noise.array,
    )
    summary = refine_motion(_packed(matches, found), _least_signal(matches), found)
    return _general_motion_fit(
        matches, fit.iterations, fit.is_planar, fit.secondary_mode, found, summary
    )


def start_at(pose: RelativePose) -> Start:
    """The start of a refinement from a result that has a direction."""
    R, t, noise = pose.rotation_cam1_from_cam0, pose.direction_cam1_from_cam0, pose.noise_px
    assert R is not None
    assert t is not None
    assert noise is not None
    stats = pose.stats
    outlier_share = (1.0 + stats.outliers) / (2.0 + stats.matches)  # Laplace's rule of succession
    return Start(R, t, Noise(noise**2, outlier_share, START_TAIL_SHARE, START_REPEATED_SHARE), R)


def evaluate_matches(matches: Matches, fit: GeneralMotionFit | Start) -> np.ndarray:
    """Residual, parallax and inlier probability (3, N) of the given matches under a fitted motion.

    The function calls `likelihood.evaluate_residuals` with the covariances of the rays in
    ``matches``, with the noise parameters of ``fit``, and with a uniform prior along the epipolar
    lines.
    """
    rows = np.empty((3, packed_length(len(matches))))
    half_width, prior = matches.outlier_half_width, matches.weights()
    evaluate_residuals(linearisation_point(fit, half_width, matches.pairs, prior), *rows)
    return rows[:, : len(matches)]


def log_densities(matches: Matches, fit: GeneralMotionFit) -> np.ndarray:
    """Log density (N,) of the given matches as inliers of a fitted motion.

    The density is that of the Sampson residual, in the unit of the noise sigma. The density along
    the epipolar line is taken as uniform, and is not a factor of the result.
    """
    residual, _, probability = evaluate_matches(matches, fit)
    outlier_share, repeated = fit.noise.outlier_share, fit.noise.repeated_share
    width = matches.outlier_half_width / REPEATED_WIDTH_RATIO
    about = 2.0 / math.pi * REPEATED_WIDTH_RATIO / (1.0 + (residual / width) ** 2)
    outliers = (1.0 - repeated + repeated * about) / (2.0 * matches.outlier_half_width)
    inlier = np.clip(probability, 1e-300, 1.0 - ROUNDING)
    odds = inlier / (1.0 - inlier) * (outlier_share / (1.0 - outlier_share))
    return np.log(outliers * odds)


def linearisation_point(
    fit: GeneralMotionFit | Start, half_width: float, pairs: np.ndarray, prior: np.ndarray
) -> LinearisationPoint:
    """Motion, noise, matches and the prior of each match, in the format of the kernels."""
    noise = fit.noise
    return LinearisationPoint(
        pairs,
        prior,
        fit.R_cam1_from_cam0,
        fit.direction_cam1_from_cam0,
        noise.array,
        half_width,
        LONG_TAIL,
    )


def packed_pose(fit: GeneralMotionFit) -> Pose:
    """The motion in the format of the kernels."""
    R, t = fit.R_cam1_from_cam0, fit.direction_cam1_from_cam0
    return Pose(R, t, fit.noise.array, np.empty((6, 6)), np.empty(1))


def _least_signal(matches: Matches) -> float:
    """Least share of signal in the shrunk flow with which a direction is observable.

    The share of noise is at most `MAX_FLOW_NOISE_SHARE`. If the noise may be misspecified, the
    sigma of the noise is assumed to be larger by the factor
    ``f = (1 + sqrt(misspecification)) / 2``, and the largest share of noise is
    ``MAX_FLOW_NOISE_SHARE / f^2``.
    """
    sigma = 0.5 * (1.0 + math.sqrt(matches.misspecification))
    return 1.0 - MAX_FLOW_NOISE_SHARE / (sigma * sigma)


def _packed(matches: Matches, found: MotionBuffers) -> PackedMatches:
    """The matches in the format of the kernels, which write the parallax prior to ``found``."""
    return matches.packed(found.per_match[0], soft_cheirality=True)


def _empty_buffers(n: int) -> MotionBuffers:
    """Output buffers of the kernels for a motion of n matches."""
    return MotionBuffers(
        R_far=IDENTITY.copy(),
        R=np.empty((3, 3)),
        t=np.empty(3),
        mixture=np.empty(4),
        per_match=np.empty((4, packed_length(n))),
        labels=np.empty(n, np.uint8),
        covariance=np.empty((5, 5)),
        R_secondary=np.empty((3, 3)),
        t_secondary=np.empty(3),
        scaled_pairs=np.empty(packed_length(n) // LANES * PANEL),
    )


def _general_motion_fit(
    matches: Matches,
    iterations: int,
    is_planar: bool,
    mode: tuple[np.ndarray, np.ndarray] | None,
    found: MotionBuffers,
    summary: MotionSummary,
) -> GeneralMotionFit:
    if summary.scales_with_parallax:
        matches = replace(matches, pairs=found.scaled_pairs)
    return GeneralMotionFit(
        R_cam1_from_cam0=found.R,
        direction_cam1_from_cam0=found.t,
        noise=Noise(*found.mixture.tolist()),
        matches=matches,
        per_match=found.per_match,
        labels=found.labels,
        covariance=found.covariance,
        has_shrunk_flow=bool(summary.has_shrunk_flow),
        shows_direction=bool(summary.shows_direction),
        iterations=iterations,
        is_planar=is_planar,
        secondary_mode=mode,
        cost=summary.cost / len(matches),
        far_rotation_cam1_from_cam0=found.R_far,
        laplace_factor=summary.laplace_factor,
        agreeing=summary.agreeing,
        sign_log_odds=summary.sign_log_odds,
        log_odds=summary.log_odds,
        beyond_rotation=summary.beyond_rotation,
        supporting=summary.supporting,
    )
