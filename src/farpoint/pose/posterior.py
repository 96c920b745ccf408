"""The likeliest of all candidate motions, and what else the matches allow.

The log evidence of a motion (`GeneralMotionFit.log_evidence`) is the log likelihood of all matches
averaged over nearby poses (Laplace), with a down-weighted prior of the parallax, plus the log
probability of the sign of the direction. The log ratio of two motions is the difference of their
log evidences plus the log-likelihood ratio of the residuals alone, with the same noise for both
motions. Tests and probabilities use this sum divided by `Matches.tempering`.

The two motions of a plane are the exception. Residuals do not contain the noise along the epipolar
lines, and the two motions have different epipolar lines. Their log likelihoods therefore differ by
chance, by about sqrt(N) for N matches. The log ratio is instead computed from the relief of the
plane (`_kernels.plane`). Relief and evidence contradict each other if they prefer different motions
and, in addition, the log evidences differ by more than 2 sqrt(N) or `Matches.tempering` exceeds 1.
Then both motions count as equally likely.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np

from farpoint._kernels.competing_modes import compare_with_mode, likeliest_other_mode
from farpoint._kernels.constants import COS_SAME_MODE, GATE_SIGMA, MAX_SEARCHED
from farpoint._kernels.plane import other_motion
from farpoint._kernels.pose import PackedMatches, Pose
from farpoint.geometry.so3 import rotation_vector
from farpoint.geometry.sphere import tangent_basis
from farpoint.pose.certainty import direction_sigma
from farpoint.pose.constants import (
    ALONG_DIFFERENCE_SHARE,
    CHANCE_SIGMA,
    COS_NEARBY,
    LINEAR_DIRECTION_SIGMA,
    LOG_RATIO_TEMPERING,
    MAX_DIRECTION_SIGMA,
    PLANE_TEMPERING,
    UNDECIDED_LOG_RATIO,
    UNDECIDED_MATCHES,
)
from farpoint.pose.general_motion import GeneralMotionFit, packed_pose, refit_general_motion
from farpoint.pose.matches import Matches
from farpoint.pose.pure_rotation import PureRotationFit

__all__ = ["Alternative", "Posterior", "compare_motions", "covariance_between"]

PLANE = "Planar ambiguity: a plane explains the matches and allows two motions"
SECONDARY = "Secondary mode: the matches are explained by two motions"


class Alternative(NamedTuple):
    """A motion that explains the matches nearly as well as the likeliest motion.

    Attributes
    ----------
    R_cam1_from_cam0 : ndarray, shape (3, 3)
    direction_cam1_from_cam0 : ndarray, shape (3,)
    log_ratio : float
        Log-likelihood ratio, at least 0, of the likeliest motion to this motion.
    cause : str
        Reason why the likelihood has two modes.
    """

    R_cam1_from_cam0: np.ndarray
    direction_cam1_from_cam0: np.ndarray
    log_ratio: float
    cause: str

    def is_nearby(self, fit: GeneralMotionFit) -> bool:
        """Whether this motion and ``fit`` have about the same direction."""
        return _cosine(self, fit) > COS_NEARBY

    def described_beside(self, fit: GeneralMotionFit) -> str:
        """Sentence with `cause` and the angle between the directions of this motion and ``fit``."""
        apart = math.acos(min(max(_cosine(self, fit), -1.0), 1.0))
        return f"{self.cause}, whose directions are {math.degrees(apart):.0f} deg apart."

    def covariance_beside(self, fit: GeneralMotionFit) -> np.ndarray:
        """Covariance (5, 5), rad^2, to add to ``fit`` because this motion may be the true motion.

        The added covariance is the probability of this motion times ``0.9 x x^T + 0.1 y y^T``. x is
        the difference ``[dtheta, dbeta]`` between the two motions, and y is x rotated by 90 degrees
        about the direction. The added covariance is zero if the two directions differ by more than
        30 degrees (`COS_SAME_MODE`).
        """
        if _cosine(self, fit) < COS_SAME_MODE:
            return np.zeros((5, 5))
        direction, turn = fit.direction_cam1_from_cam0, self._turn_from(fit)
        basis = tangent_basis(direction)
        tilt = basis @ (basis.T @ self.direction_cam1_from_cam0)
        aside = np.cross(direction, turn) + (direction @ turn) * direction
        along = np.concatenate([turn, basis.T @ tilt])
        across = np.concatenate([aside, basis.T @ np.cross(direction, tilt)])
        mixed = ALONG_DIFFERENCE_SHARE * np.outer(along, along) + (
            1.0 - ALONG_DIFFERENCE_SHARE
        ) * np.outer(across, across)
        return self.probability(fit.matches.tempering, PLANE_TEMPERING) * mixed

    def rotation_covariance_beside(self, fit: GeneralMotionFit) -> np.ndarray:
        """Covariance (3, 3), rad^2, to add to the rotation of ``fit`` for the case of this motion.

        The covariance is that of `covariance_between` with the probability of this motion.
        """
        return covariance_between(self._turn_from(fit), self.probability(fit.matches.tempering))

    def probability(self, misspecification: float, tempering: float = LOG_RATIO_TEMPERING) -> float:
        """Probability of this motion.

        The probability is ``1 / (1 + exp(tempering * log_ratio / misspecification))``, where
        ``misspecification`` is the factor `Matches.tempering`, and ``tempering`` is the tempering
        exponent of a comparison of two motions.
        """
        return 1.0 / (1.0 + math.exp(min(tempering * self.log_ratio / misspecification, 700.0)))

    def _turn_from(self, fit: GeneralMotionFit) -> np.ndarray:
        return np.array(rotation_vector(self.R_cam1_from_cam0 @ fit.R_cam1_from_cam0.T))


class Posterior(NamedTuple):
    """The likeliest motion, and the likeliest of the other motions.

    Attributes
    ----------
    fit : GeneralMotionFit
        The likeliest motion.
    alternative : Alternative, optional
        Another motion that the data do not rule out at the false-alarm rate: the likeliest in
        another direction, or the other motion of a plane.
    of_plane : Alternative, optional
        The other motion of a plane, also if it is ruled out.
    """

    fit: GeneralMotionFit
    alternative: Alternative | None
    of_plane: Alternative | None

    @property
    def has_other_direction(self) -> bool:
        """Whether there is an alternative with clearly another direction."""
        return self.alternative is not None and not self.alternative.is_nearby(self.fit)

    def covariance(self) -> np.ndarray:
        """Covariance (5, 5), rad^2, of the likeliest motion and of the other motion of a plane."""
        covariance = self.fit.averaged_covariance
        if self.of_plane is None or self.has_other_direction:
            return covariance
        return covariance + self.of_plane.covariance_beside(self.fit)


def covariance_between(apart: np.ndarray, probability: float) -> np.ndarray:
    """Covariance (3, 3), rad^2, to add to a rotation if another rotation has this probability.

    ``apart`` is the rotation vector between the two rotations. The covariance is the probability
    times the squared length of ``apart``: a share of 0.9 along ``apart``, and an isotropic share of
    0.1 for the case that neither of the two rotations is the true one.
    """
    isotropic = float(apart @ apart) / 3.0 * np.eye(3)
    return probability * (
        ALONG_DIFFERENCE_SHARE * np.outer(apart, apart) + (1.0 - ALONG_DIFFERENCE_SHARE) * isotropic
    )


def compare_motions(
    matches: Matches,
    fit: GeneralMotionFit,
    candidates: Iterable[GeneralMotionFit],
    pure_rotation: Callable[[], PureRotationFit],
    rate: float,
) -> Posterior:
    """Refine the candidate motions by all matches, and compare them with a fitted motion.

    A motion is ruled out if its log ratio to the likeliest motion is at least ``log(1 / rate)``
    times `Matches.tempering`. A candidate cannot become the likeliest motion if the z-score of its
    residual correlation exceeds both `GATE_SIGMA` and the z-score of ``fit``, because the candidate
    may be a merged mode of two motions. If the direction of the likeliest motion is uncertain, and
    all motions in other directions are ruled out, a search in other directions follows.
    """
    of_plane = _other_of_plane(fit)
    pool = [refit_general_motion(matches, start) for start in candidates]
    z_score = max(fit.neighbours.z_score, GATE_SIGMA)
    likely = [each for each in _unless_near(of_plane, pool) if each.neighbours.z_score <= z_score]
    best = fit
    for each in likely:
        best = each if _log_ratio(best, each) < 0.0 else best
    if best is not fit:
        of_plane = _other_of_plane(best)
    if of_plane is not None:
        best, of_plane = _likelier_of_plane(best, of_plane)
    limit = -fit.matches.tempering * math.log(rate)
    others = [_alternative(best, each) for each in _unless_near(of_plane, [fit, *pool])]
    others = [of_plane, *others] if of_plane is not None else others
    possible = [each for each in others if each.log_ratio < limit]
    apart = [each for each in possible if not each.is_nearby(best)]
    if not apart and _has_uncertain_direction(best):
        apart = [*_in_other_direction(best, pure_rotation().R_cam1_from_cam0, limit)]
    nearest = min(apart, key=lambda each: each.log_ratio, default=None)
    if nearest is None and of_plane is not None and of_plane.log_ratio < limit:
        nearest = of_plane
    return Posterior(best, nearest, of_plane)


def _unless_near(other: Alternative | None, pool: list[GeneralMotionFit]) -> list[GeneralMotionFit]:
    """The motions of a pool that are not near the other motion of a plane."""
    return pool if other is None else [each for each in pool if _cosine(each, other) < COS_NEARBY]


def _log_ratio(one: GeneralMotionFit, other: GeneralMotionFit) -> float:
    """Log ratio of two motions: difference of their evidences, plus log ratio by residuals alone.

    The evidence contains the prior of the parallax, which is estimated separately for each motion
    and therefore favours motions that leave little parallax. The log-likelihood ratio of the
    residuals alone has a uniform prior, and does not favour such motions. In this second ratio both
    motions have the same noise, the smaller of their two noises: the noise is a property of the
    tracker and not of a motion, and with a larger noise a motion could take outliers as inliers.
    For motions in about the same direction, the result is the difference of the evidences alone.
    `LOG_RATIO_TEMPERING`, 0.5, in `Alternative.probability` turns the sum of both log ratios into
    their mean.
    """
    difference = one.log_evidence - other.log_evidence
    if _cosine(one, other) > COS_NEARBY:
        return difference
    noise = min(one.noise, other.noise, key=lambda each: each.variance)
    matches = _packed(one.matches.with_noise_up_to(noise.variance), UNDECIDED_MATCHES)
    pose, mode = packed_pose(one)._replace(mixture=noise.array), _empty_pose()
    mode.R[:], mode.t[:] = other.R_cam1_from_cam0, other.direction_cam1_from_cam0
    by_residuals = compare_with_mode(matches, pose, mode)
    return difference + (by_residuals if math.isfinite(by_residuals) else 0.0)


def _alternative(best: GeneralMotionFit, other: GeneralMotionFit) -> Alternative:
    """Another motion of the pool, with its log ratio."""
    R, direction = other.R_cam1_from_cam0, other.direction_cam1_from_cam0
    return Alternative(R, direction, max(_log_ratio(best, other), 0.0), SECONDARY)


def _has_uncertain_direction(fit: GeneralMotionFit) -> bool:
    """Whether a fit shows a direction that is so uncertain that there may be another mode."""
    sigma = direction_sigma(fit.averaged_covariance)
    return fit.shows_direction and LINEAR_DIRECTION_SIGMA < sigma < MAX_DIRECTION_SIGMA


def _in_other_direction(
    fit: GeneralMotionFit, R_pure_rotation: np.ndarray, limit: float
) -> Iterator[Alternative]:
    """The likeliest mode in another direction, if its log ratio is below the limit.

    The log ratio of ``fit`` to the mode is that of the residuals alone, because the prior of the
    parallax was estimated with ``fit`` and favours modes near ``fit``. The searches start at
    ``R_pure_rotation``, which lies between the rotations of two modes that explain the same flow
    by different shares of rotation and translation.
    """
    pose, mode = packed_pose(fit), _empty_pose()
    log_ratio = likeliest_other_mode(
        _packed(fit.matches, MAX_SEARCHED), pose, R_pure_rotation, mode
    )
    if log_ratio < UNDECIDED_LOG_RATIO and len(fit.matches) > MAX_SEARCHED:
        log_ratio = compare_with_mode(_packed(fit.matches, UNDECIDED_MATCHES), pose, mode)
    if log_ratio < limit:
        yield Alternative(mode.R, mode.t, max(log_ratio, 0.0), SECONDARY)


def _cosine(one: Alternative | GeneralMotionFit, other: Alternative | GeneralMotionFit) -> float:
    """Cosine of the angle between the directions of two motions."""
    return float(one.direction_cam1_from_cam0 @ other.direction_cam1_from_cam0)


def _other_of_plane(fit: GeneralMotionFit) -> Alternative | None:
    """The second motion of a plane, with the log ratio by relief, if a plane explains the matches.

    The ratio is negative if the relief favours the second motion.
    """
    if not fit.is_planar:
        return None
    pose, other, has_given_noise = packed_pose(fit), _empty_pose(), fit.matches.misspecification > 1
    competes, log_ratio = other_motion(
        _packed(fit.matches, MAX_SEARCHED), pose, other, has_given_noise
    )
    if competes and log_ratio < UNDECIDED_LOG_RATIO and len(fit.matches) > MAX_SEARCHED:
        some = _packed(fit.matches, UNDECIDED_MATCHES)
        competes, log_ratio = other_motion(some, pose, other, has_given_noise)
    return Alternative(other.R, other.t, log_ratio, PLANE) if competes else None


def _packed(matches: Matches, most: int) -> PackedMatches:
    """At most ``most`` evenly spaced matches in the format of the kernels.

    The soft cheirality penalty is switched off.
    """
    part = matches.subsample(most)
    return part.packed(part.weights(), soft_cheirality=False)


def _empty_pose() -> Pose:
    """Buffers in which the kernels return a pose."""
    return Pose(np.empty((3, 3)), np.empty(3), np.empty(4), np.empty((6, 6)), np.empty(1))


def _likelier_of_plane(
    fit: GeneralMotionFit, other: Alternative
) -> tuple[GeneralMotionFit, Alternative]:
    """The likelier and the less likely of the two motions of a plane.

    Relief and evidence contradict each other if they prefer different motions and, in addition,
    `Matches.tempering` exceeds 1 or the log evidences differ by more than `CHANCE_SIGMA` times
    sqrt(N). Both motions are then taken as equally likely, and the motion with the larger evidence
    is returned first. ``fit`` is also returned first if the refinement of the other motion
    converges to ``fit``.
    """
    found = refit_general_motion(
        fit.matches, fit.at(other.R_cam1_from_cam0, other.direction_cam1_from_cam0)
    )
    if _cosine(found, fit) > _cosine(found, other):
        return fit, other._replace(log_ratio=max(other.log_ratio, 0.0))
    gain, chance = found.log_evidence - fit.log_evidence, math.sqrt(len(fit.matches))
    is_decisive = fit.matches.tempering > 1.0 or abs(gain) > CHANCE_SIGMA * chance
    is_contradiction = is_decisive and gain * other.log_ratio > 0.0
    log_ratio = 0.0 if is_contradiction else abs(other.log_ratio)
    if (gain if is_contradiction else -other.log_ratio) <= 0.0:
        return fit, other._replace(log_ratio=log_ratio)
    R, direction = fit.R_cam1_from_cam0, fit.direction_cam1_from_cam0
    return found, Alternative(R, direction, log_ratio, PLANE)
