"""Competing motions: modes with nearly the same likelihood, and the choice between such modes."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from farpoint._kernels.competing_modes import compare_with_mode, likeliest_other_mode
from farpoint._kernels.constants import COS_SAME_MODE, MAX_SEARCHED, OUTER_ROUNDS
from farpoint._kernels.plane import other_motion
from farpoint._kernels.pose import PackedMatches, Pose
from farpoint.geometry.so3 import rotation_vector
from farpoint.geometry.sphere import tangent_basis
from farpoint.pose.certainty import direction_sigma
from farpoint.pose.constants import (
    ALONG_DIFFERENCE_SHARE,
    CLEAR_MARGIN,
    COS_NEARBY,
    EFFECTIVE_PER_ROOT,
    EVALUATED_LOG_RATIO_PER_MATCH,
    LINEAR_DIRECTION_SIGMA,
    LOG_RATIO_TEMPERING,
    MAX_DIRECTION_SIGMA,
    MAX_EVALUATED_LOG_RATIO,
    PLANE_TEMPERING,
    UNDECIDED_LOG_RATIO,
    UNDECIDED_MATCHES,
)
from farpoint.pose.covariance import general_motion_covariance
from farpoint.pose.general_motion import GeneralMotionFit, packed_pose, refit_general_motion
from farpoint.pose.pure_rotation import PureRotationFit

__all__ = [
    "ComparedModes",
    "CompetingMotion",
    "compare_modes",
    "covariance_between",
    "likelier_in_other_direction",
    "likelier_of_plane",
    "likelier_of_search",
]


PLANE = "Planar ambiguity: a plane explains the matches and allows two motions"
ELSEWHERE = "Secondary mode: two motions explain the matches"


class CompetingMotion(NamedTuple):
    """A second motion that explains the matches nearly as well as the first motion.

    Attributes
    ----------
    R_cam1_from_cam0 : ndarray, shape (3, 3)
    direction_cam1_from_cam0 : ndarray, shape (3,)
    log_ratio : float
        Log-likelihood ratio of the first motion to this motion.
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
        """A sentence that states the cause and the angle between the directions of both motions."""
        apart = math.acos(min(max(_cosine(self, fit), -1.0), 1.0))
        return f"{self.cause}, whose directions are {math.degrees(apart):.0f} deg apart."

    def covariance_beside(self, fit: GeneralMotionFit) -> np.ndarray:
        """Covariance (5, 5), rad^2, to add to ``fit`` because this motion may be the true motion.

        The added covariance is the squared difference between the two motions times the probability
        of this motion. A share of 0.1 of the squared difference is rotated by 90 degrees about the
        direction. The added covariance is zero if the two directions are far apart.
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
        """Covariance (3, 3), rad^2, to add to the rotation of ``fit`` because this motion may be
        the true motion.
        """
        return covariance_between(self._turn_from(fit), self.probability(fit.matches.tempering))

    def probability(self, misspecification: float, tempering: float = LOG_RATIO_TEMPERING) -> float:
        """Probability of this motion.

        The probability is ``1 / (1 + exp(tempering * log_ratio / misspecification))``, where
        ``misspecification`` is the misspecification factor of the noise variance.
        """
        return 1.0 / (1.0 + math.exp(min(tempering * self.log_ratio / misspecification, 700.0)))

    def _turn_from(self, fit: GeneralMotionFit) -> np.ndarray:
        return np.array(rotation_vector(self.R_cam1_from_cam0 @ fit.R_cam1_from_cam0.T))


def covariance_between(apart: np.ndarray, probability: float) -> np.ndarray:
    """Covariance (3, 3), rad^2, to add to a rotation if another rotation has this probability.

    ``apart`` is the rotation vector between the two rotations. The covariance is the probability
    times the squared length of ``apart``: a share of 0.9 along ``apart``, and an isotropic share of
    0.1 for the case that a third rotation is the true one.
    """
    isotropic = float(apart @ apart) / 3.0 * np.eye(3)
    return probability * (
        ALONG_DIFFERENCE_SHARE * np.outer(apart, apart) + (1.0 - ALONG_DIFFERENCE_SHARE) * isotropic
    )


def _cosine(
    one: CompetingMotion | GeneralMotionFit, other: CompetingMotion | GeneralMotionFit
) -> float:
    """Cosine of the angle between the directions of two motions."""
    return float(one.direction_cam1_from_cam0 @ other.direction_cam1_from_cam0)


class ComparedModes(NamedTuple):
    """The likeliest motion after comparison with other motions.

    Attributes
    ----------
    fit : GeneralMotionFit
    covariance : ndarray, shape (5, 5)
        Covariance of rotation and direction, rad^2. If the matches lie on a plane, the difference
        to the second motion of the plane is included.
    secondary_mode : CompetingMotion, optional
        Another mode that the data do not rule out.
    """

    fit: GeneralMotionFit
    covariance: np.ndarray
    secondary_mode: CompetingMotion | None


def compare_modes(
    fit: GeneralMotionFit,
    of_plane: CompetingMotion | None,
    pure_rotation: Callable[[], PureRotationFit],
    rate: float,
) -> ComparedModes:
    """Compare a motion with competing motions, and select the likeliest.

    The competing motions are the second motion of a plane, the secondary mode of the search, the
    likeliest other candidate and, if the direction is uncertain, a mode in another direction. The
    search for another direction starts from the ``pure_rotation``. A mode is ruled out at the
    false-alarm rate ``rate``.
    """
    # A misspecified noise variance scales the log-likelihood ratio.
    limit = -fit.matches.tempering * math.log(rate)
    best, mode, nearby = fit, _within(limit, of_plane), None
    if mode is not None and mode.is_nearby(fit):
        mode, nearby = None, mode
    if mode is None and fit.secondary_mode is not None:
        best, other = likelier_of_search(fit)
        # The order of the two modes is uncertain only if the noise may be misspecified.
        mode = _within(limit, other) if fit.matches.misspecification > 1.0 else None
    if mode is None and best is fit:
        mode = _within(limit, _candidate_mode(fit))
    covariance = general_motion_covariance(best)
    nearby = nearby if best is fit else None
    if best is fit and mode is None and of_plane is not None:
        covariance += of_plane.covariance_beside(fit)
    has_direction = mode is None and best.shows_direction
    if has_direction and LINEAR_DIRECTION_SIGMA < direction_sigma(covariance) < MAX_DIRECTION_SIGMA:
        likelier, other = likelier_in_other_direction(best, pure_rotation)
        mode = _within(limit, other)
        if likelier is not best:
            return ComparedModes(likelier, general_motion_covariance(likelier), mode)
    return ComparedModes(best, covariance, nearby if mode is None else mode)


def _candidate_mode(fit: GeneralMotionFit) -> CompetingMotion | None:
    """The likeliest other candidate of a fit with large noise; None if its direction is nearby."""
    if fit.candidate_mode is None:
        return None
    other = CompetingMotion(*fit.candidate_mode, ELSEWHERE)
    return None if other.is_nearby(fit) else other


def _within(limit: float, other: CompetingMotion | None) -> CompetingMotion | None:
    """The ``other`` motion if the log-likelihood ratio to it is below the limit, else None."""
    return other if other is not None and other.log_ratio < limit else None


def likelier_of_plane(fit: GeneralMotionFit) -> tuple[GeneralMotionFit, CompetingMotion | None]:
    """The likelier and the less likely of two motions: the fit, and the second motion of a plane.

    The second result is usually None: no plane explains the matches nearly as well as the fit.
    """
    return _likelier(fit, _other_of_plane(fit) if fit.is_planar else None)


def likelier_of_search(fit: GeneralMotionFit) -> tuple[GeneralMotionFit, CompetingMotion | None]:
    """The likelier and the less likely of two motions: the fit, and the search's second mode."""
    if fit.secondary_mode is None:
        return fit, None
    R, t = (each.copy() for each in fit.secondary_mode)
    mode = Pose(R, t, np.empty(4), np.empty((6, 6)), np.empty(1))
    log_ratio = compare_with_mode(_packed_subsample(fit, UNDECIDED_MATCHES), packed_pose(fit), mode)
    return _likelier(fit, _competing(mode, log_ratio, ELSEWHERE) if log_ratio < np.inf else None)


def likelier_in_other_direction(
    fit: GeneralMotionFit, pure_rotation: Callable[[], PureRotationFit]
) -> tuple[GeneralMotionFit, CompetingMotion | None]:
    """The likelier and the less likely of two motions: the fit, and a mode in another direction.

    If the search finds a likelier motion, the search is repeated from that motion, up to
    `OUTER_ROUNDS` times. If every round finds a likelier motion, or if residuals and parallax
    prefer different motions, the last two motions count as equally likely.
    """
    # Two modes that exchange translation and rotation have the pure rotation half-way between them.
    middle, other = pure_rotation().R_cam1_from_cam0, None
    for _ in range(OUTER_ROUNDS):
        found = _in_other_direction(fit, middle)
        if found is None or found.log_ratio >= 0.0:
            return fit, found
        before = fit
        fit, other = _likelier(fit, found)
        if fit is before:
            break
    return fit, other and other._replace(log_ratio=0.0)


def _likelier(
    fit: GeneralMotionFit, other: CompetingMotion | None
) -> tuple[GeneralMotionFit, CompetingMotion | None]:
    """The likelier and the less likely of two motions, by residuals and parallax of all matches.

    The log-likelihood ratio to the other motion comes from the residuals or, for a plane, from the
    points off the plane. This ratio may be due to chance or to correlated outliers. The other
    motion is therefore fitted to all matches, too, and must gain more likelihood by the parallax of
    the matches than the tempered ratio. If residuals and parallax prefer different motions, or if
    the fit of the other motion converges to the first motion, both motions count as equally likely.

    The required gain is larger where parallax has less information: if the flow is mostly noise,
    and for a plane, because all points lie on one surface.
    """
    limit = fit.matches.misspecification * min(
        MAX_EVALUATED_LOG_RATIO, EVALUATED_LOG_RATIO_PER_MATCH * len(fit.matches)
    )
    if other is None or other.log_ratio >= limit:
        return fit, other
    R, t = fit.R_cam1_from_cam0, fit.direction_cam1_from_cam0
    start = fit.at(other.R_cam1_from_cam0, other.direction_cam1_from_cam0)
    found = refit_general_motion(fit.matches, start)
    if _cosine(found, fit) > _cosine(found, other):
        return fit, other._replace(log_ratio=max(other.log_ratio, 0.0))
    gain = _tempered_log_likelihood(found) - _tempered_log_likelihood(fit)
    if other.log_ratio >= 0.0:
        margin = CLEAR_MARGIN if found.has_shrunk_flow else 0.0
        is_ambiguous = gain > margin
        margin += CLEAR_MARGIN if other.cause == PLANE else 0.0
        is_likelier = gain > margin + LOG_RATIO_TEMPERING * other.log_ratio
    else:
        is_agreed = found.log_likelihood > fit.log_likelihood
        is_likelier = is_agreed or (other.cause == PLANE and gain > -CLEAR_MARGIN)
        is_ambiguous = True
    if is_likelier:
        return found, CompetingMotion(R, t, max(-other.log_ratio, 0.0), other.cause)
    return fit, other._replace(log_ratio=0.0) if is_ambiguous else other


def _tempered_log_likelihood(fit: GeneralMotionFit) -> float:
    """Log likelihood in which the parallax prior counts for fewer matches than there are.

    The parallax prior of a match is estimated from the other matches, and matches of one surface
    are correlated, so the effective number of matches is smaller. The log likelihood includes the
    sign of the direction: with the opposite direction most points would lie behind the cameras.
    """
    n = len(fit.matches)
    by_prior = float(fit.probability @ np.log(fit.per_match[0, :n]))
    by_sign = -float(np.logaddexp(0.0, -fit.sign_log_odds))
    redundant = 1.0 - min(EFFECTIVE_PER_ROOT / math.sqrt(n), 1.0)
    return fit.log_likelihood + by_sign - redundant * by_prior


def _in_other_direction(fit: GeneralMotionFit, R_start: np.ndarray) -> CompetingMotion | None:
    pose, mode = packed_pose(fit), _empty_pose()
    packed = _packed_subsample(fit, MAX_SEARCHED)
    log_ratio = likeliest_other_mode(packed, pose, R_start, mode)
    if log_ratio < UNDECIDED_LOG_RATIO and len(fit.matches) > MAX_SEARCHED:
        log_ratio = compare_with_mode(_packed_subsample(fit, UNDECIDED_MATCHES), pose, mode)
    return _competing(mode, log_ratio, ELSEWHERE) if log_ratio < np.inf else None


def _other_of_plane(fit: GeneralMotionFit) -> CompetingMotion | None:
    pose, other = packed_pose(fit), _empty_pose()
    has_given_noise = fit.matches.misspecification > 1.0
    packed = _packed_subsample(fit, MAX_SEARCHED)
    competes, log_ratio = other_motion(packed, pose, other, has_given_noise)
    if competes and log_ratio < UNDECIDED_LOG_RATIO and len(fit.matches) > MAX_SEARCHED:
        packed = _packed_subsample(fit, UNDECIDED_MATCHES)
        competes, log_ratio = other_motion(packed, pose, other, has_given_noise)
    return _competing(other, log_ratio, PLANE) if competes else None


def _competing(pose: Pose, log_ratio: float, cause: str) -> CompetingMotion:
    return CompetingMotion(pose.R, pose.t, log_ratio, cause)


def _packed_subsample(fit: GeneralMotionFit, most: int) -> PackedMatches:
    """At most ``most`` evenly spaced matches in the format of the kernels.

    The soft cheirality penalty is switched off.
    """
    part = fit.matches.subsample(most)
    return part.packed(part.weights(), soft_cheirality=False)


def _empty_pose() -> Pose:
    """Buffers in which the kernels return a pose."""
    return Pose(np.empty((3, 3)), np.empty(3), np.empty(4), np.empty((6, 6)), np.empty(1))
