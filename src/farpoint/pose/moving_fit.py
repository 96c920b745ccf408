"""The model of a camera that moves, fitted to its maximum likelihood.

Rotation and direction; a match is free along its epipolar line. It is right with normal noise of
unknown size, or wrong; the noise and the share of wrong matches are estimated along (EM).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from farpoint._kernels.contest import NEAR
from farpoint._kernels.five_rays import Effort
from farpoint._kernels.likelihood import explain
from farpoint._kernels.mixture import TAIL
from farpoint._kernels.motion import fit_motion
from farpoint._kernels.pairs import LANES, PANEL, packed_length
from farpoint._kernels.plausible import BAND_SIGMA
from farpoint._kernels.pose import PackedMatches, Pose, Seen
from farpoint._kernels.settling import MAX_SEARCHED, Found, Settled, settle_motion
from farpoint.pose.far_rotation import IDENTITY
from farpoint.pose.matches import Matches
from farpoint.pose.noise import Noise
from farpoint.pose.options import RelativePoseOptions

__all__ = [
    "MovingFit",
    "fit_moving",
    "fit_quietly",
    "is_likelier",
    "is_plainly_likelier",
    "judge",
    "pose_of",
    "refit_moving",
    "seen_by",
]

# Samples of few matches, over all that there are, until half of them have been drawn: then all k
# without a wrong match are missed with a probability of 2^-k, and a consensus has many.
HALF_SEEN = math.log(2.0)
# Where more than this of the flow, as it is predicted, is noise, along any axis, it shows no
# direction: points that are all far have such flow, and half of their directions are wrong.
MOST_NOISE = 0.55


@dataclass(frozen=True, kw_only=True, eq=False)
class MovingFit:
    """Rotation and direction of translation.

    Attributes
    ----------
    R_cam1_from_cam0 : ndarray, shape (3, 3)
    direction_cam1_from_cam0 : ndarray, shape (3,)
    noise : Noise
    matches : Matches
        Those that were fitted.
    said : ndarray, shape (4, at least N)
        What is plausible of each match, by where it lies along its epipolar line, as the kernels
        take it; and the rows of `residual`, `parallax` and `probability`.
    labels : ndarray of uint8, shape (N,)
        0 for a match that disagrees, 2 for one with parallax beyond the noise, else 1.
    covariance : ndarray, shape (5, 5)
        Of rotation and direction, at this pose; infinite where the matches fix no rotation.
    is_predicted : bool
        Whether by the flow that the matches let expect of each, since much of it is noise.
    shows_direction : bool
        Whether enough of it is signal even so.
    iterations : int
        Joint hypotheses tried.
    is_planar : bool
        Whether the second motion that a plane allows may explain the matches nearly as well.
    rival : tuple of ndarray, shapes (3, 3) and (3,), or None
        Rotation and direction, cam1_from_cam0, of another motion that did, if one was met.
    cost : float
        Mean negative log likelihood of a match.
    far_rotation_cam1_from_cam0 : ndarray, shape (3, 3)
        Rotation that the search began with: that of the far points.
    narrowness : float
        What the log likelihood of all matches loses when it is averaged over the poses nearby.
    agreeing : int
        Matches that do not disagree.
    sign_log_odds : float
        Of the direction against its opposite.
    log_odds : float
        Of the motion against all matches wrong.
    beyond_rotation, supporting : int
        Of the right matches searched, those that contradict every rotation that may fit; and all.
    coherence : float
        Correlation of the residuals of right matches with those of their neighbours; 0 for few.
    likeness : float
        That over what noise would have.
    design_effect : float
        How many times larger the variance of a sum of residuals is, over parts of the image, than
        if they were independent, where they are not likely to be.
    between : float
        Coherence of a likelier motion that was taken to lie between this and another; else 0.
    unsettled : tuple of ndarray, shapes (3, 3) and (3,), and float, or None
        Rotation and direction, cam1_from_cam0, of another motion that was held against this one
        where there is much noise, and by how much the log likelihood of this one is larger, at
        least 0.
    """

    R_cam1_from_cam0: np.ndarray
    direction_cam1_from_cam0: np.ndarray
    noise: Noise
    matches: Matches
    said: np.ndarray
    labels: np.ndarray
    covariance: np.ndarray
    is_predicted: bool
    shows_direction: bool
    iterations: int
    is_planar: bool
    rival: tuple[np.ndarray, np.ndarray] | None
    cost: float
    far_rotation_cam1_from_cam0: np.ndarray
    narrowness: float
    agreeing: int
    sign_log_odds: float
    log_odds: float
    beyond_rotation: int
    supporting: int
    coherence: float
    likeness: float
    design_effect: float
    between: float
    unsettled: tuple[np.ndarray, np.ndarray, float] | None = None

    def at(self, R_cam1_from_cam0: np.ndarray, direction_cam1_from_cam0: np.ndarray) -> MovingFit:
        """Another motion, with the same noise: where to refit from."""
        return replace(
            self,
            R_cam1_from_cam0=R_cam1_from_cam0,
            direction_cam1_from_cam0=direction_cam1_from_cam0,
        )

    @property
    def log_likelihood(self) -> float:
        """Of all matches, averaged over the poses nearby."""
        return -self.cost * len(self.matches) - self.narrowness

    @property
    def sign_probability(self) -> float:
        """Of the direction, not its opposite, to be the right one."""
        return 1.0 / (1.0 + math.exp(-min(max(self.sign_log_odds, -700.0), 700.0)))

    @property
    def residual(self) -> np.ndarray:
        """Sampson residual (N,) of each match for unit noise."""
        return self.said[1, : len(self.matches)]

    @property
    def parallax(self) -> np.ndarray:
        """Signed shift (N,) along the epipolar line, towards the direction.

        In units of its own noise for unit noise: what is left of the distance from the rotation's
        prediction.
        """
        return self.said[2, : len(self.matches)]

    @property
    def probability(self) -> np.ndarray:
        """Of each match (N,) to be right."""
        return self.said[3, : len(self.matches)]


def fit_moving(
    matches: Matches, tolerance: float, options: RelativePoseOptions, state: np.ndarray
) -> MovingFit:
    """Maximum-likelihood rotation and direction, searched for from the far rotation.

    The direction that the derotated flow suggests is refined jointly with the rotation. Then
    five-ray hypotheses challenge it: with no far points, or parallax that a rotation can imitate,
    the first answer is a local minimum. Where the search saw some of the matches only, and two
    motions came near each other, all are asked; the second must be plainly likelier.
    """
    n = len(matches)
    found = _nothing_found(n)
    samples = max(options.min_iterations, math.ceil(HALF_SEEN * math.comb(n, 5)))
    effort = Effort(
        tolerance=tolerance,
        confidence=options.confidence,
        min_iterations=options.min_iterations,
        max_iterations=min(samples, options.max_iterations),
    )
    iterations, is_planar, has_met, has_second, numbers = fit_motion(
        _judging(matches, found), effort, _least_signal(matches), state, found
    )
    rival = (found.R_rival, found.t_rival) if has_met else None
    fit = _moving_fit(matches, iterations, bool(is_planar), rival, found, Settled(*numbers))
    if not has_second:
        return fit
    second = refit_moving(matches, fit.at(found.R_second, found.t_second))
    if not is_plainly_likelier(second, fit):
        return fit
    return replace(second, rival=(fit.R_cam1_from_cam0, fit.direction_cam1_from_cam0))


def fit_quietly(
    matches: Matches,
    variance: float,
    samples: int,
    tolerance: float,
    options: RelativePoseOptions,
    state: np.ndarray,
) -> MovingFit:
    """As `fit_moving` of some of the matches, with few samples, and no larger noise than this.

    ``variance`` is in units of the matches' noise, squared; ``samples`` the most that are drawn.
    """
    least, most = (min(n, samples) for n in (options.min_iterations, options.max_iterations))
    effort = replace(options, min_iterations=least, max_iterations=most)
    some = matches.some(MAX_SEARCHED).with_noise_up_to(variance)
    return fit_moving(some, tolerance, effort, state)


def is_plainly_likelier(fit: MovingFit, other: MovingFit) -> bool:
    """Whether a fit is likelier than another, and by more than two that came near each other."""
    return is_likelier(fit, other, by=NEAR)


def is_likelier(fit: MovingFit, other: MovingFit, by: float = 0.0) -> bool:
    """Whether a fit is likelier than another to the same matches, by parallax and by its ratios.

    What is plausible of a match is a density of its parallax. That grows where all shrink, for a
    rotation that takes some of what they share; a density of their ratios does not.
    """
    by_parallax = fit.log_likelihood - other.log_likelihood
    return min(by_parallax, by_parallax + _log_ratios(fit) - _log_ratios(other)) > by


def _log_ratios(fit: MovingFit) -> float:
    """Logarithm of the density of all parallax over that of its ratios."""
    return float(fit.probability @ np.log(np.hypot(fit.parallax / fit.noise.sigma, BAND_SIGMA)))


def refit_moving(matches: Matches, fit: MovingFit) -> MovingFit:
    """The fit to the same matches with another noise told, from where the first one ended."""
    found = _nothing_found(len(matches))._replace(
        R_far=fit.far_rotation_cam1_from_cam0,
        R=fit.R_cam1_from_cam0.copy(),
        t=fit.direction_cam1_from_cam0.copy(),
        mixture=fit.noise.array,
    )
    settled = Settled(*settle_motion(_judging(matches, found), _least_signal(matches), found))
    return _moving_fit(matches, fit.iterations, fit.is_planar, fit.rival, found, settled)


def judge(matches: Matches, fit: MovingFit) -> np.ndarray:
    """Residual, parallax and probability (3, N) of matches, also others, by the motion fitted.

    Those that `likelihood.explain` tells, by the noise of these matches, wherever they lie along
    their epipolar lines.
    """
    rows = np.empty((3, packed_length(len(matches))))
    explain(seen_by(fit, matches.pairs, matches.weights()), *rows)
    return rows[:, : len(matches)]


def seen_by(fit: MovingFit, pairs: np.ndarray, prior: np.ndarray) -> Seen:
    """These matches as the motion sees them, for the kernels."""
    noise = fit.noise
    return Seen(
        pairs,
        prior,
        fit.R_cam1_from_cam0,
        fit.direction_cam1_from_cam0,
        noise.array,
        fit.matches.spread,
        TAIL,
    )


def pose_of(fit: MovingFit) -> Pose:
    """The motion, as the kernels take it."""
    R, t = fit.R_cam1_from_cam0, fit.direction_cam1_from_cam0
    return Pose(R, t, fit.noise.array, np.empty((6, 6)), np.empty(1))


def _least_signal(matches: Matches) -> float:
    """Share of the flow that must be signal to show a direction.

    The more, the more the sigma of the noise is in doubt: half of that is allowed for.
    """
    sigma = 0.5 * (1.0 + math.sqrt(matches.doubt))
    return 1.0 - MOST_NOISE / (sigma * sigma)


def _judging(matches: Matches, found: Found) -> PackedMatches:
    """The matches as the kernels take them, which tell in ``found`` what is plausible of each."""
    return matches.judging(found.said[0], gives_way=True)


def _nothing_found(n: int) -> Found:
    """Room for a motion of so many matches."""
    return Found(
        R_far=IDENTITY.copy(),
        R=np.empty((3, 3)),
        t=np.empty(3),
        mixture=np.empty(4),
        said=np.empty((4, packed_length(n))),
        labels=np.empty(n, np.uint8),
        covariance=np.empty((5, 5)),
        R_second=np.empty((3, 3)),
        t_second=np.empty(3),
        R_rival=np.empty((3, 3)),
        t_rival=np.empty(3),
        grown=np.empty(packed_length(n) // LANES * PANEL),
    )


def _moving_fit(
    matches: Matches,
    iterations: int,
    is_planar: bool,
    rival: tuple[np.ndarray, np.ndarray] | None,
    found: Found,
    settled: Settled,
) -> MovingFit:
    if settled.grows:
        matches = replace(matches, pairs=found.grown)
    return MovingFit(
        R_cam1_from_cam0=found.R,
        direction_cam1_from_cam0=found.t,
        noise=Noise(*found.mixture.tolist()),
        matches=matches,
        said=found.said,
        labels=found.labels,
        covariance=found.covariance,
        is_predicted=bool(settled.is_predicted),
        shows_direction=bool(settled.shows_direction),
        iterations=iterations,
        is_planar=is_planar,
        rival=rival,
        cost=settled.cost / len(matches),
        far_rotation_cam1_from_cam0=found.R_far,
        narrowness=settled.narrowness,
        agreeing=settled.agreeing,
        sign_log_odds=settled.sign_log_odds,
        log_odds=settled.log_odds,
        beyond_rotation=settled.beyond_rotation,
        supporting=settled.supporting,
        coherence=settled.coherence,
        likeness=settled.likeness,
        design_effect=settled.design_effect,
        between=0.0,
    )
