"""A motion that was found, settled by all matches: refined, labelled, and how sure it is."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.compile import kernel, step_kernel
from farpoint._kernels.contest import COARSE, narrowness
from farpoint._kernels.covariance import (
    MEASURED,
    PLAIN,
    PREDICTED,
    covariance_here,
    step_by_prediction,
)
from farpoint._kernels.evidence import NEAR_SIGMA, count_beyond_rotation, weigh
from farpoint._kernels.growth import grow_noise
from farpoint._kernels.likelihood import explain
from farpoint._kernels.mixture import NO_TAIL, mean_variance
from farpoint._kernels.pairs import LANES, PANEL, take_pairs
from farpoint._kernels.plausible import plausible_parallax
from farpoint._kernels.pose import PackedMatches, Pose, Seen
from farpoint._kernels.refinement import refine_pose
from farpoint._kernels.sharing import tell_sharing

__all__ = [
    "MAX_REFINEMENTS",
    "MAX_SEARCHED",
    "Found",
    "Numbers",
    "Settled",
    "every_so_manieth",
    "searched_of",
    "settle",
    "settle_motion",
]

# The search looks at this many matches: more make it slower, not surer.
MAX_SEARCHED = 160
# Log likelihood to which the result is refined: a thirtieth of a sigma.
FINE = 1e-3
MAX_REFINEMENTS = np.int64(20)
# How often what is plausible is asked again, at the pose that it has led to.
MAX_ROUNDS = 4


class Settled(NamedTuple):
    """What all matches say of a motion, in numbers.

    Kernels give them to Python as a plain tuple: to make a record they would run Python, which an
    interrupt may end there, and numba does not look.
    """

    cost: float
    """Negative log likelihood."""
    narrowness: float
    """As of `contest.narrowness`."""
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
    is_predicted: bool
    """Whether the covariance is by the flow that is predicted."""
    shows_direction: bool
    """Whether enough of that is signal."""
    grows: bool
    """Whether the noise was found to grow with the parallax."""
    coherence: float
    """Correlation of residuals with those of their neighbours."""
    likeness: float
    """That over what noise would have."""
    design_effect: float
    """As of `sharing.tell_sharing`."""


# What `Settled` is made of.
Numbers = tuple[float, float, int, float, float, int, int, bool, bool, bool, float, float, float]


class Found(NamedTuple):
    """A motion and what its matches say of it."""

    R_far: np.ndarray
    """(3, 3) rotation of the far matches, cam1_from_cam0."""
    R: np.ndarray
    """(3, 3) rotation cam1_from_cam0."""
    t: np.ndarray
    """(3,) direction cam1_from_cam0."""
    mixture: np.ndarray
    """(4,) as of `pose.Pose`."""
    said: np.ndarray
    """(4, at least N) of each match: its prior, by what is plausible of it, and, as of
    `likelihood.explain`, its residual, parallax and chance to be right."""
    labels: np.ndarray
    """(N,) as of `evidence.weigh`."""
    covariance: np.ndarray
    """(5, 5) of rotation and direction, as of `covariance.covariance_here`."""
    R_second: np.ndarray
    """(3, 3) rotation of the second motion that came near, wherever, if one did."""
    t_second: np.ndarray
    """(3,) its direction."""
    R_rival: np.ndarray
    """(3, 3) rotation of the motion elsewhere that the search met, if it did."""
    t_rival: np.ndarray
    """(3,) its direction."""
    grown: np.ndarray
    """Panels of the matches with the noise that was found, if it grows with the parallax."""


@kernel
def every_so_manieth(pairs: np.ndarray, count: int) -> np.ndarray:
    """As many of the ``count`` matches as the search looks at."""
    rows, taken = np.empty(MAX_SEARCHED, np.int64), np.empty(MAX_SEARCHED // LANES * PANEL)
    for j in range(MAX_SEARCHED):
        rows[j] = j * count // MAX_SEARCHED
    take_pairs(pairs, rows, taken)
    return taken


@step_kernel
def searched_of(some: np.ndarray, matches: PackedMatches) -> PackedMatches:
    """Those of the matches, with nothing known of them, and errors without a tail."""
    total = matches.total if matches.total < MAX_SEARCHED else MAX_SEARCHED
    prior = np.empty(some.size // PANEL * LANES)
    _leave_out_none(prior, total)
    spread, least, most = matches.spread, matches.min_variance, matches.max_variance
    return PackedMatches(some, prior, total, spread, NO_TAIL, least, most, matches.gives_way)


@step_kernel
def _leave_out_none(prior: np.ndarray, count: int) -> None:
    """Prior 1 for each match, 0 for those that fill up the panels."""
    for i in range(prior.size):
        prior[i] = 1.0 if i < count else 0.0


def settle_motion(matches: PackedMatches, least_signal: float, found: Found) -> Numbers:
    """Refine a pose by all matches, with what parallax they make plausible, and hear them on it.

    As `refinement.refine_pose`; the prior of ``matches``, the first row of what is ``said``,
    receives what is plausible of each. It shows a direction if at least ``least_signal`` of the
    flow is signal.
    """
    return settle(some_of(matches), matches, least_signal, found)


def some_of(matches: PackedMatches) -> np.ndarray:
    """Panels of the matches that the search looks at."""
    few = matches.total <= MAX_SEARCHED
    return matches.pairs if few else every_so_manieth(matches.pairs, matches.total)


def settle(some: np.ndarray, matches: PackedMatches, least_signal: float, found: Found) -> Numbers:
    """As `settle_motion`, with the panels of `some_of` them."""
    cost, narrow, right, grows = _settle(matches, found)
    if grows:
        matches = matches._replace(pairs=found.grown)
    seen = Seen(
        matches.pairs,
        matches.prior,
        found.R,
        found.t,
        found.mixture,
        matches.spread,
        matches.tail,
    )
    predicted, shows = _be_sure(seen, right, least_signal, found)
    said, count = found.said, matches.total
    heard = _weigh_all(some, count, found.R, found.R_far, found.mixture, said, found.labels)
    sharing = tell_sharing(matches.pairs, said[1], said[3], count, math.sqrt(found.mixture[0]))
    return (cost, narrow, *heard, predicted, shows, grows, *sharing)


@kernel
def _settle(matches: PackedMatches, found: Found) -> tuple[float, float, float, bool]:
    """Refine the pose, and once more when its noise is known.

    Returns its cost, its `contest.narrowness`, the expected number of right matches, and whether
    their noise grows.
    """
    normal, cost, grows = np.empty((6, 6)), 0.0, False
    for precision in (COARSE, FINE):
        told = _with_noise(matches, found.grown if grows else matches.pairs)
        cost = _refine(told, precision, found, normal)
        if precision == COARSE:
            residual, parallax, right = found.said[1], found.said[2], found.said[3]
            variance, grown = found.mixture[0], found.grown
            grows = grow_noise(
                matches.pairs, residual, parallax, right, matches.total, variance, grown
            )
    total = 0.0
    for i in range(matches.total):
        total += found.said[3, i]
    return cost, narrowness(normal), total, grows


@kernel
def _weigh_all(
    some: np.ndarray,
    count: int,
    R: np.ndarray,
    R_far: np.ndarray,
    mixture: np.ndarray,
    said: np.ndarray,
    labels: np.ndarray,
) -> tuple[int, float, float, int, int]:
    """What `evidence.weigh` returns of all, and `evidence.count_beyond_rotation` of some."""
    right = said[3]
    agreeing, odds, likelier = weigh(said[2], right, math.sqrt(mixture[0]), mixture[1], labels)
    prior = np.empty(some.size // PANEL * LANES)
    total = min(count, MAX_SEARCHED)
    for j in range(prior.size):
        prior[j] = 1.0 if j < total and right[j * count // total] > 0.5 else 0.0
    # A pose may take some of the flow: a match is off a rotation by twice what its noise would do.
    distance = 2.0 * NEAR_SIGMA * math.sqrt(mean_variance(mixture[0], mixture[2]))
    beyond, supporting = count_beyond_rotation(some, prior, R, R_far, distance)
    return agreeing, odds, likelier, beyond, supporting


@step_kernel
def _with_noise(matches: PackedMatches, pairs: np.ndarray) -> PackedMatches:
    """The matches, with the noise of these panels."""
    total, spread, tail, prior = matches.total, matches.spread, matches.tail, matches.prior
    least, most, gives_way = matches.min_variance, matches.max_variance, matches.gives_way
    return PackedMatches(pairs, prior, total, spread, tail, least, most, gives_way)


@step_kernel
def _explain(matches: PackedMatches, found: Found) -> None:
    """As `likelihood.explain`."""
    said = found.said
    explain(_seen(matches, found), said[1], said[2], said[3])


@step_kernel
def _seen(matches: PackedMatches, found: Found) -> Seen:
    """The matches as the pose sees them."""
    spread, tail = matches.spread, matches.tail
    return Seen(matches.pairs, matches.prior, found.R, found.t, found.mixture, spread, tail)


@step_kernel
def _refine(matches: PackedMatches, precision: float, found: Found, normal: np.ndarray) -> float:
    """As `refinement.refine_pose`, by what the pose as it was makes plausible of the matches.

    Again where it ends at a pose that some of them made, and from which they lie too far away.
    """
    pose = Pose(found.R, found.t, found.mixture, normal, np.empty(1))
    for _ in range(MAX_ROUNDS):
        end = _plausible(matches, found)
        refine_pose(matches, precision, MAX_REFINEMENTS, pose)
        _explain(matches, found)
        if not _beyond(end, found.said[2], found.said[3]):
            break
    return pose.cost[0]


@step_kernel
def _plausible(matches: PackedMatches, found: Found) -> float:
    """As `plausible.plausible_parallax`, of all matches alike."""
    _leave_out_none(matches.prior, matches.total)
    _explain(matches, found)
    parallax, right, sigma = found.said[2], found.said[3], math.sqrt(found.mixture[0])
    return plausible_parallax(parallax, right, matches.total, sigma, matches.spread, matches.prior)


@step_kernel
def _beyond(end: float, parallax: np.ndarray, right: np.ndarray) -> int:
    """Right matches of more parallax."""
    count = 0
    for i in range(right.size):
        count += 1 if right[i] > 0.5 and parallax[i] > end else 0
    return count


def _be_sure(seen: Seen, right: float, least_signal: float, found: Found) -> tuple[bool, bool]:
    """Covariance of the pose; where much of the flow is noise, by predicted flow, as is the pose.

    Returns whether it was predicted, and whether at least so much of it is signal.
    """
    if covariance_here(seen, right, MEASURED, PLAIN, found.covariance):
        return False, True
    step_by_prediction(seen)
    explain(seen, found.said[1], found.said[2], found.said[3])
    return True, covariance_here(seen, right, PREDICTED, least_signal, found.covariance)
