"""Explanations of the matches by two motions: the camera's, and that of an object or of dirt.

The likelihood may have a mode between two motions, a merged mode, which explains all matches with
more noise. The merged mode may be likelier than the motion of the camera, because the noise scale
is free. One motion is therefore compared with two motions. The log likelihood of two motions is
that of a mixture,

    sum_i log(w_1 f_1(i) + w_2 f_2(i) + w_0 u),

with the densities f_k of the inliers of each motion, the density u of outliers, and shares w. The
second motion is a general motion, or matches that are stationary in the image, such as dirt on the
lens, the bonnet, or a caption.

Two motions must separate the matches: the entropy of the responsibilities is subtracted from the
log likelihood. With errors that are smooth over the image, such as errors of a lens or a shutter,
two motions are likelier than one, too, but do not separate the matches. The log ratio of two
motions to one is divided by the design effect of the residuals of one motion, as every log ratio of
correlated residuals. Finally, the residuals of the camera's motion must be independent between
neighbours.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from farpoint._kernels.classification import classify
from farpoint._kernels.constants import (
    EM_ROUNDS,
    GATE_SIGMA,
    MAX_SEARCHED,
    MIN_MATCHES,
    REMAINING_GAIN_FACTOR,
)
from farpoint._kernels.evidence import find_stationary
from farpoint.geometry.vectors import median
from farpoint.pose.constants import (
    CANDIDATE_SAMPLES,
    DOMINANT_SHARE,
    MAD_TO_SIGMA,
    MAX_STATIONARY_SHARE,
    MERGED_MODE_NOISE_RATIO,
    MIN_INDEPENDENT_SHARE,
    MIN_PART_MATCHES,
    MIN_STATIONARY_SHARE,
    SEARCH_NOISE_BOUND,
    TWO_MOTIONS_MARGIN,
)
from farpoint.pose.general_motion import (
    GeneralMotionFit,
    evaluate_matches,
    fit_general_motion,
    fit_with_bounded_noise,
    log_densities,
    refit_general_motion,
)
from farpoint.pose.matches import Matches
from farpoint.pose.options import RelativePoseOptions

__all__ = ["TwoMotions", "explain_by_two"]


class TwoMotions(NamedTuple):
    """An explanation of the matches by the motion of the camera and a second motion.

    Attributes
    ----------
    matches : Matches
        The matches that do not follow the second motion.
    fit : GeneralMotionFit
        The motion of the camera, fitted to these matches.
    second : GeneralMotionFit or None
        The second motion; None if its matches are stationary in the image.
    following : int
        Number of matches that follow the second motion.
    log_ratio : float
        Log likelihood of two motions, minus the entropy of the responsibilities, minus the log
        likelihood of one motion; divided by the design effect. Each likelihood is averaged over
        nearby poses before the logarithm is taken (Laplace factor).
    """

    matches: Matches
    fit: GeneralMotionFit
    second: GeneralMotionFit | None
    following: int
    log_ratio: float

    def described(self) -> str:
        """A sentence about the second motion."""
        if self.second is None:
            return (
                f"Stationary matches: {self.following} matches stand still in the image and move "
                "with the camera, as dirt on its lens does."
            )
        return (
            f"Independently moving object or repeated structure: {self.following} matches follow "
            "another motion than that of the camera."
        )


class _Classified(NamedTuple):
    """Two motions, the index (N,) of the motion that each match follows, and the gain.

    Index 2 stands for outliers. The gain is the log likelihood of two motions, minus the entropy of
    the responsibilities, minus the log likelihood of one motion. Each likelihood is averaged over
    nearby poses before the logarithm is taken (Laplace factor).
    """

    first: GeneralMotionFit
    second: GeneralMotionFit | None
    follows: np.ndarray
    gain: float


def explain_by_two(
    matches: Matches,
    fit: GeneralMotionFit,
    tolerance: float,
    options: RelativePoseOptions,
    state: np.ndarray,
) -> TwoMotions | None:
    """The likeliest explanation by two motions, if it is clearly likelier than ``fit`` alone.

    An explanation by stationary matches is tried first, because stationary matches have no unknown
    motion. Two general motions are tried only if this explanation is not clearly likelier than
    ``fit``.
    """
    arguments = matches, fit, tolerance, options, state
    for starts in (_with_stationary(*arguments), _with_bounded_noise(*arguments)):
        found = [_explanation(matches, fit, *start) for start in starts]
        best = max(filter(None, found), key=lambda each: each.log_ratio, default=None)
        if best is not None and best.log_ratio > TWO_MOTIONS_MARGIN:
            return best
    return None


def _with_stationary(
    matches: Matches,
    fit: GeneralMotionFit,
    tolerance: float,
    options: RelativePoseOptions,
    state: np.ndarray,
) -> Iterator[tuple[GeneralMotionFit, None]]:
    """The motion of the matches that are not stationary in the image.

    If the camera does not rotate, far points are stationary in the image, too. The motion of the
    other matches then also explains the far points.
    """
    stationary = np.empty(len(matches), bool)
    within = min(GATE_SIGMA * fit.noise.sigma, tolerance)
    count = find_stationary(matches.pairs, within, stationary)
    least, most = MIN_STATIONARY_SHARE * len(matches), MAX_STATIONARY_SHARE * len(matches)
    if count >= MIN_MATCHES and least <= count <= most:
        yield fit_general_motion(matches.select(~stationary), tolerance, options, state), None


def _with_bounded_noise(
    matches: Matches,
    fit: GeneralMotionFit,
    tolerance: float,
    options: RelativePoseOptions,
    state: np.ndarray,
) -> Iterator[tuple[GeneralMotionFit, GeneralMotionFit]]:
    """The motion found with a bounded noise, and the motion of the other matches.

    The bound of the noise variance is 0.2 times the residual variance that is independent between
    neighbours. The second motion is found in the same way from the other matches. There is no
    search if residuals are independent between neighbours (z-score at most `GATE_SIGMA`), or if
    the noise sigma is below `MERGED_MODE_NOISE_RATIO` times the tolerance.
    """
    if (
        fit.neighbours.z_score <= GATE_SIGMA
        or fit.noise.sigma < MERGED_MODE_NOISE_RATIO * tolerance
    ):
        return
    sigma = MAD_TO_SIGMA * median(np.abs(fit.residual[fit.probability > 0.5]))
    independent = max(1.0 - fit.neighbours.correlation, MIN_INDEPENDENT_SHARE) * sigma**2
    bound = SEARCH_NOISE_BOUND * independent, CANDIDATE_SAMPLES, tolerance, options, state
    first = fit_with_bounded_noise(matches, *bound)
    rest = evaluate_matches(matches, first)[2] < 0.5
    if MIN_PART_MATCHES <= np.count_nonzero(rest) <= len(matches) - MIN_PART_MATCHES:
        others = matches.select(rest)
        yield first, fit_with_bounded_noise(others, *bound)


def _explanation(
    matches: Matches,
    fit: GeneralMotionFit,
    first: GeneralMotionFit,
    second: GeneralMotionFit | None,
) -> TwoMotions | None:
    """The explanation near two motions, found with a part of the matches, then with all of them."""
    some = _classify(matches.subsample(MAX_SEARCHED), len(matches), fit, first, second)
    if some is None or len(matches) <= MAX_SEARCHED:
        found = some
    else:
        found = _classify(matches, len(matches), fit, some.first, some.second)
    return None if found is None else _of_camera(matches, fit, found)


def _classify(
    matches: Matches,
    total: int,
    fit: GeneralMotionFit,
    first: GeneralMotionFit,
    second: GeneralMotionFit | None,
) -> _Classified | None:
    """Two motions near the given ones, by classification EM; None if one motion is likelier.

    Classification EM: Celeux and Govaert, Comput. Stat. Data Anal. 14, 1992, DOI
    10.1016/0167-9473(92)90042-E. The gain is that of the integrated classification likelihood: the
    log likelihood minus the entropy of the responsibilities, minus the log likelihood of one motion
    (Biernacki, Celeux and Govaert, IEEE PAMI 22, 2000, DOI 10.1109/34.865189). EM ends if an upper
    bound of the final gain is negative. If ``matches`` are a subsample of ``total`` matches, one
    sigma of the sampling error is added to the upper bound.
    """
    unused = 1.0 - len(matches) / total
    alone, gain, follows = _log_likelihoods(matches, fit), -math.inf, np.zeros(0, np.int64)
    for _ in range(EM_ROUNDS):
        densities = log_densities(matches, first), _second_density(matches, first, second)
        before = gain, follows
        follows, classified = _classification(matches, *densities)
        gains = classified - alone
        gain = float(np.sum(gains)) + fit.laplace_factor - first.laplace_factor
        if second is not None:
            gain -= second.laplace_factor
        sampling = math.sqrt(unused * np.var(gains) * len(matches))
        if gain + REMAINING_GAIN_FACTOR * (gain - before[0]) + sampling < 0.0:
            return None
        counts = np.bincount(follows, minlength=2)[:2]
        if min(counts) < MIN_MATCHES and not unused:
            return None
        if min(counts) < MIN_MATCHES or np.array_equal(follows, before[1]):
            break
        first = refit_general_motion(matches.select(follows != 1), first)
        if second is not None:
            second = refit_general_motion(matches.select(follows != 0), second)
    return _Classified(first, second, follows, gain)


def _of_camera(matches: Matches, fit: GeneralMotionFit, found: _Classified) -> TwoMotions | None:
    """The explanation in which the camera has one of the two motions; None if it has neither.

    Of two general motions, the one whose matches have the larger scatter in the image is tried
    first: an object is compact, and the scene is around it. Stationary matches are compared by
    their number, and do not follow the motion of the camera. The motion of the camera must have
    more matches than `DOMINANT_SHARE` times the inliers of ``fit``, and residuals that are
    independent between neighbours (z-score at most `GATE_SIGMA`).
    """
    motions, counts = (found.first, found.second), np.bincount(found.follows, minlength=2)
    sizes = [float(count) for count in counts]
    if found.second is not None:
        sizes = [_scatter(matches.rays0[found.follows == k]) for k in (0, 1)]
    for k in (0, 1) if sizes[0] >= sizes[1] else (1, 0):
        camera, other = motions[k], motions[1 - k]
        if camera is None:
            return None
        is_dominant = counts[k] > DOMINANT_SHARE * fit.agreeing
        if is_dominant and camera.neighbours.z_score <= GATE_SIGMA:
            kept = matches.select(found.follows != 1 - k)
            log_ratio = found.gain / fit.neighbours.design_effect
            return TwoMotions(kept, camera, other, int(counts[1 - k]), log_ratio)
    return None


def _scatter(rays: np.ndarray) -> float:
    """Sum of the squared distances of rays (N, 3) from their mean."""
    return float(np.sum(np.var(rays, axis=0))) * len(rays) if len(rays) else 0.0


def _classification(
    matches: Matches, one: np.ndarray, two: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Component (N,) that each match follows, and classification log likelihoods (N,).

    ``one`` and ``two`` (N,) are the log densities of the matches under two motions.
    """
    outliers = np.full(len(matches), -math.log(2.0 * matches.outlier_half_width))
    follows, log_likelihoods = np.empty(len(matches), np.int64), np.empty(len(matches))
    classify(np.stack([one, two, outliers]), follows, log_likelihoods)
    return follows, log_likelihoods


def _log_likelihoods(matches: Matches, fit: GeneralMotionFit) -> np.ndarray:
    """Log likelihoods (N,) of one motion, comparable with those of `_classification`."""
    share = fit.noise.outlier_share
    outliers = math.log(share / (2.0 * matches.outlier_half_width))
    inliers = math.log1p(-share) + log_densities(matches, fit)
    return np.logaddexp(inliers, outliers)


def _second_density(
    matches: Matches, first: GeneralMotionFit, second: GeneralMotionFit | None
) -> np.ndarray:
    """Log density (N,) of the inliers of the second motion, or of stationary matches.

    The density of a stationary match is the normal density of its flow in two dimensions, divided
    by the density along the epipolar line of a match without parallax. The densities of
    `log_densities` do not contain a density along the line either.
    """
    if second is not None:
        return log_densities(matches, second)
    flow2 = np.sum((matches.rays1 - matches.rays0) ** 2, axis=1) * matches.precision
    sigma = first.noise.sigma
    return -0.5 * flow2 / sigma**2 - math.log(math.sqrt(2.0 * math.pi) * sigma)
