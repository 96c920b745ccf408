"""Other motions that explain the matches nearly as well, and which of two it was."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from farpoint._kernels.plane import other_motion
from farpoint._kernels.pose import PackedMatches, Pose
from farpoint._kernels.rivals import judge_rival, nearest_rival
from farpoint._kernels.settling import MAX_SEARCHED
from farpoint.geometry.sphere import tangent_basis
from farpoint.pose.certainty import MAX_DIRECTION_SIGMA, direction_sigma
from farpoint.pose.covariance import moving_covariance
from farpoint.pose.moving_fit import MovingFit, pose_of, refit_moving
from farpoint.pose.small import rotation_vector
from farpoint.pose.turning_fit import TurningFit

__all__ = [
    "Held",
    "OtherMotion",
    "doubt_between",
    "hold_against_rivals",
    "likelier_elsewhere",
    "likelier_met",
    "likelier_of_plane",
]

# A direction less certain than this (1 sigma, rad) may have a rival, which is looked for.
DOUBTED_SIGMA = math.radians(2.5)

# Motions elsewhere that are gone to, each likelier than the one before.
ROUNDS = 3
# Log likelihood by which some of the matches must be against a motion, or more of them are asked.
DOUBT = 20.0
MORE = 4 * MAX_SEARCHED

# Two motions whose directions are as near as this are one, the less sure.
COS_NEARBY = math.cos(math.radians(10.0))
# Up to here a direction is the less sure for the other motion of a plane, even if that is unlikely.
COS_IN_REACH = math.cos(math.radians(30.0))

# Log likelihood that residuals may have against a motion that is the right one, in all and for each
# match; and that by which places of matches must speak more clearly where they tell less.
CONTESTED, FOR_EACH, CLEAR = 60.0, 0.25, 8.0
# Of n matches as many lie there by themselves as this times the root of n, at the most.
SURFACES = 5.0

# Share of a difference of log likelihoods that tells the odds of two motions. Each is free along
# other lines, and so counts another part of the same noise: a second one of 5 to 7 less is the
# right one in 3 of 100 simulated scenes, not in 1 of 400. So much of what residuals have against a
# motion must be outweighed, too.
HEARD = 0.5
# The same of the two of a plane and all that lies between: to points of a plane these look alike.
HEARD_BETWEEN = 0.3
# Share of the doubt between two motions along the axis on which they differ.
ALONG = 0.9

PLANE = "A plane explains the matches and allows two motions"
ELSEWHERE = "Two motions explain the matches"


class OtherMotion(NamedTuple):
    """A second motion that explains the matches.

    Attributes
    ----------
    R_cam1_from_cam0 : ndarray, shape (3, 3)
    direction_cam1_from_cam0 : ndarray, shape (3,)
    against : float
        By how much the log likelihood of the first motion is larger, as far as it is not chance.
    because : str
        Why there are two.
    """

    R_cam1_from_cam0: np.ndarray
    direction_cam1_from_cam0: np.ndarray
    against: float
    because: str

    def is_nearby(self, fit: MovingFit) -> bool:
        """Whether it goes about the same way."""
        return _cosine(self, fit) > COS_NEARBY

    def said_beside(self, fit: MovingFit) -> str:
        """A sentence of why there are two, and how far they are apart."""
        apart = math.acos(min(max(_cosine(self, fit), -1.0), 1.0))
        return f"{self.because}, whose directions are {math.degrees(apart):.0f} deg apart."

    def doubt_of(self, fit: MovingFit) -> np.ndarray:
        """Covariance (5, 5), rad^2, of a motion that may be this one of a plane, or lie between.

        The square of what the two differ by times a probability, and a little of the same turned by
        a quarter about the direction. Nothing of two that are far apart.
        """
        if _cosine(self, fit) < COS_IN_REACH:
            return np.zeros((5, 5))
        direction, turn = fit.direction_cam1_from_cam0, self._turn_from(fit)
        basis = tangent_basis(direction)
        tilt = basis @ (basis.T @ self.direction_cam1_from_cam0)
        aside = np.cross(direction, turn) + (direction @ turn) * direction
        along = np.concatenate([turn, basis.T @ tilt])
        across = np.concatenate([aside, basis.T @ np.cross(direction, tilt)])
        mixed = ALONG * np.outer(along, along) + (1.0 - ALONG) * np.outer(across, across)
        return self.probability(fit.matches.tempering, HEARD_BETWEEN) * mixed

    def doubt_of_rotation(self, fit: MovingFit) -> np.ndarray:
        """Covariance (3, 3), rad^2, of a rotation that this one's may be, or a third."""
        return doubt_between(self._turn_from(fit), self.probability(fit.matches.tempering))

    def probability(self, doubt: float, heard: float = HEARD) -> float:
        """Of this motion to be the right one, if the variance of the noise is in so much doubt.

        Where that may be misstated by a factor, so may be the logarithm of a likelihood. Of that,
        so much is ``heard``.
        """
        return 1.0 / (1.0 + math.exp(min(heard * self.against / doubt, 700.0)))

    def _turn_from(self, fit: MovingFit) -> np.ndarray:
        return np.array(rotation_vector(self.R_cam1_from_cam0 @ fit.R_cam1_from_cam0.T))


def doubt_between(apart: np.ndarray, probability: float) -> np.ndarray:
    """Covariance (3, 3), rad^2, of a rotation, where another one has this probability.

    The square of the rotation vector by which the two are ``apart`` times that, most of it along
    the axis of it: a third one may differ from both any way.
    """
    any_way = float(apart @ apart) / 3.0 * np.eye(3)
    return probability * (ALONG * np.outer(apart, apart) + (1.0 - ALONG) * any_way)


def _cosine(one: OtherMotion | MovingFit, other: OtherMotion | MovingFit) -> float:
    """Of the angle between their directions."""
    return float(one.direction_cam1_from_cam0 @ other.direction_cam1_from_cam0)


class Held(NamedTuple):
    """The likeliest motion, held against the others.

    Attributes
    ----------
    fit : MovingFit
    covariance : ndarray, shape (5, 5)
        Of its rotation and direction, rad^2; it allows for the other motion of a plane.
    rival : OtherMotion, optional
        One that cannot be told from it.
    """

    fit: MovingFit
    covariance: np.ndarray
    rival: OtherMotion | None


def hold_against_rivals(
    fit: MovingFit,
    of_plane: OtherMotion | None,
    turned: Callable[[], TurningFit],
    rate: float,
) -> Held:
    """Hold a motion against that of a plane, that which the search has met, and one looked for.

    The last only where the direction is in doubt, from the rotation of the matches ``turned``. Two
    motions are told apart at this false-alarm ``rate``.
    """
    # Where the variance of the noise may be misstated, so may be the logarithm of a likelihood.
    limit = -fit.matches.tempering * math.log(rate)
    best, rival, nearby = fit, _within(limit, of_plane), None
    if rival is not None and rival.is_nearby(fit):
        rival, nearby = None, rival
    if rival is None and fit.rival is not None:
        best, other = likelier_met(fit)
        # Which of the two is the likelier is in doubt where their noise is.
        rival = _within(limit, other) if fit.matches.doubt > 1.0 else None
    if rival is None and best is fit:
        rival = _within(limit, _unsettled(fit))
    covariance = moving_covariance(best)
    nearby = nearby if best is fit else None
    if best is fit and rival is None and of_plane is not None:
        covariance += of_plane.doubt_of(fit)
    is_told = rival is None and best.shows_direction
    if is_told and DOUBTED_SIGMA < direction_sigma(covariance) < MAX_DIRECTION_SIGMA:
        likelier, other = likelier_elsewhere(best, turned)
        rival = _within(limit, other)
        if likelier is not best:
            return Held(likelier, moving_covariance(likelier), rival)
    return Held(best, covariance, nearby if rival is None else rival)


def _unsettled(fit: MovingFit) -> OtherMotion | None:
    """The motion that it was held against where there is much noise, if that goes another way."""
    if fit.unsettled is None:
        return None
    other = OtherMotion(*fit.unsettled, ELSEWHERE)
    return None if other.is_nearby(fit) else other


def _within(limit: float, other: OtherMotion | None) -> OtherMotion | None:
    """The other motion, if no more of a log likelihood is against it."""
    return other if other is not None and other.against < limit else None


def likelier_of_plane(fit: MovingFit) -> tuple[MovingFit, OtherMotion | None]:
    """The fit, or one to the other motion that a plane allows if that is likelier; and the rival.

    Usually there is none: no plane explains the matches nearly as well.
    """
    return _likelier(fit, _other_of_plane(fit) if fit.is_planar else None)


def likelier_met(fit: MovingFit) -> tuple[MovingFit, OtherMotion | None]:
    """The fit, or one to a motion that the search has met if that is likelier; and the rival."""
    if fit.rival is None:
        return fit, None
    R, t = (each.copy() for each in fit.rival)
    rival = Pose(R, t, np.empty(4), np.empty((6, 6)), np.empty(1))
    against = judge_rival(_some(fit, MORE), pose_of(fit), rival)
    return _likelier(fit, _other(rival, against, ELSEWHERE) if against < np.inf else None)


def likelier_elsewhere(
    fit: MovingFit, turned: Callable[[], TurningFit]
) -> tuple[MovingFit, OtherMotion | None]:
    """The fit, or one to a motion in quite another direction if that is likelier; and the rival.

    Where each one found is not as likely as the next, there is no telling: the rival is as likely.
    """
    # Half-way between two motions that take each other's translation for a turn.
    between, other = turned().R_cam1_from_cam0, None
    for _ in range(ROUNDS):
        found = _elsewhere(fit, between)
        if found is None or found.against >= 0.0:
            return fit, found
        before = fit
        fit, other = _likelier(fit, found)
        if fit is before:
            break
    return fit, other and other._replace(against=0.0)


def _likelier(fit: MovingFit, other: OtherMotion | None) -> tuple[MovingFit, OtherMotion | None]:
    """The likelier of the two by all that the matches tell, and the one that it then is not.

    What is against the other is told by residuals, of a plane by its relief. That may be chance, or
    matches that go wrong together. So all are fitted to the other, too, and asked where they lie on
    their lines: those outweigh what was against it. Where the two contradict each other, or all
    matches lead back, there is no telling: the other is as likely.

    Places of matches tell less where flow is mostly noise, and of a plane, which is one surface.
    """
    contested = fit.matches.doubt * min(CONTESTED, FOR_EACH * len(fit.matches))
    if other is None or other.against >= contested:
        return fit, other
    R, t = fit.R_cam1_from_cam0, fit.direction_cam1_from_cam0
    start = fit.at(other.R_cam1_from_cam0, other.direction_cam1_from_cam0)
    found = refit_moving(fit.matches, start)
    if _cosine(found, fit) > _cosine(found, other):
        return fit, other._replace(against=max(other.against, 0.0))
    gain = _by_surfaces(found) - _by_surfaces(fit)
    if other.against >= 0.0:
        asked = CLEAR if found.is_predicted else 0.0
        is_in_doubt = gain > asked
        asked += CLEAR if other.because == PLANE else 0.0
        is_likelier = gain > asked + HEARD * other.against
    else:
        is_agreed = found.log_likelihood > fit.log_likelihood
        is_likelier = is_agreed or (other.because == PLANE and gain > -CLEAR)
        is_in_doubt = True
    if is_likelier:
        return found, OtherMotion(R, t, max(-other.against, 0.0), other.because)
    return fit, other._replace(against=0.0) if is_in_doubt else other


def _by_surfaces(fit: MovingFit) -> float:
    """Log likelihood, by where matches lie on their lines only as far as they do by themselves.

    What is plausible of a match is learnt from the others: those of one surface lie together. Of a
    motion the other way round, most would lie behind the cameras.
    """
    n = len(fit.matches)
    by_place = float(fit.probability @ np.log(fit.said[0, :n]))
    by_sign = -float(np.logaddexp(0.0, -fit.sign_log_odds))
    not_by_themselves = 1.0 - min(SURFACES / math.sqrt(n), 1.0)
    return fit.log_likelihood + by_sign - not_by_themselves * by_place


def _elsewhere(fit: MovingFit, R_start: np.ndarray) -> OtherMotion | None:
    pose, rival = pose_of(fit), _some_pose()
    against = nearest_rival(_some(fit, MAX_SEARCHED), pose, R_start, rival)
    if against < DOUBT and len(fit.matches) > MAX_SEARCHED:
        against = judge_rival(_some(fit, MORE), pose, rival)
    return _other(rival, against, ELSEWHERE) if against < np.inf else None


def _other_of_plane(fit: MovingFit) -> OtherMotion | None:
    pose, other = pose_of(fit), _some_pose()
    is_told = fit.matches.doubt > 1.0
    is_rival, against = other_motion(_some(fit, MAX_SEARCHED), pose, other, is_told)
    if is_rival and against < DOUBT and len(fit.matches) > MAX_SEARCHED:
        is_rival, against = other_motion(_some(fit, MORE), pose, other, is_told)
    return _other(other, against, PLANE) if is_rival else None


def _other(pose: Pose, against: float, because: str) -> OtherMotion:
    return OtherMotion(pose.R, pose.t, against, because)


def _some(fit: MovingFit, most: int) -> PackedMatches:
    """Every so manieth match, as the kernels take them: no motion gives way to any."""
    seen = fit.matches.some(most)
    return seen.judging(seen.weights(), gives_way=False)


def _some_pose() -> Pose:
    """Room for a motion."""
    return Pose(np.empty((3, 3)), np.empty(3), np.empty(4), np.empty((6, 6)), np.empty(1))
