"""A motion that was found, settled by all matches: refined, labelled, and how sure it is."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.compile import inner_kernel, kernel
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
from farpoint._kernels.scratch import index_room, room, scratch
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


@inner_kernel
def every_so_manieth(pairs: np.ndarray, count: int) -> np.ndarray:
    """As many of the ``count`` matches as the search looks at."""
    rows, taken = index_room(MAX_SEARCHED), room(MAX_SEARCHED // LANES * PANEL)
    for j in range(MAX_SEARCHED):
        rows[j] = j * count // MAX_SEARCHED
    take_pairs(pairs, rows, taken)
    return taken


@inner_kernel
def searched_of(some: np.ndarray, matches: PackedMatches) -> PackedMatches:
    """Those of the matches, with nothing known of them, and errors without a tail."""
    total = matches.total if matches.total < MAX_SEARCHED else MAX_SEARCHED
    prior = room(some.size // PANEL * LANES)
    _leave_out_none(prior, total)
    spread, least, most = matches.spread, matches.min_variance, matches.max_variance
    return PackedMatches(some, prior, total, spread, NO_TAIL, least, most, matches.gives_way)


@inner_kernel
def _leave_out_none(prior: np.ndarray, count: int) -> None:
    """Prior 1 for each match, 0 for those that fill up the panels."""
    for i in range(prior.size):
        prior[i] = 1.0 if i < count else 0.0


@kernel
def settle_motion(matches: PackedMatches, least_signal: float, found: Found) -> Numbers:
    """Refine a pose by all matches, with what parallax they make plausible, and hear them on it.

    As `refinement.refine_pose`; the prior of ``matches``, the first row of what is ``said``,
    receives what is plausible of each. It shows a direction if at least ``least_signal`` of the
    flow is signal.
    """
    # A kernel that handed back the array itself would make numba lose count of who holds it.
    few = matches.total <= MAX_SEARCHED
    some = matches.pairs if few else every_so_manieth(matches.pairs, matches.total)
    return settle(searched_of(some, matches), matches, least_signal, found)


@inner_kernel
def settle(
    searched: PackedMatches, matches: PackedMatches, least_signal: float, found: Found
) -> Numbers:
    """As `settle_motion`; the prior of those searched is then 1 only for the right ones."""
    normal, count = scratch(6, 6), matches.total
    _refine(matches, COARSE, found, normal)
    residual, parallax, right = found.said[1], found.said[2], found.said[3]
    variance, grown = found.mixture[0], found.grown
    grows = grow_noise(matches.pairs, residual, parallax, right, count, variance, grown)
    pairs = grown if grows else matches.pairs
    spread, least, most = matches.spread, matches.min_variance, matches.max_variance
    prior, tail, gives_way = matches.prior, matches.tail, matches.gives_way
    told = PackedMatches(pairs, prior, count, spread, tail, least, most, gives_way)
    return _conclude(searched, told, least_signal, grows, found)


@inner_kernel
def _explain(matches: PackedMatches, found: Found) -> None:
    """As `likelihood.explain`."""
    said = found.said
    explain(_seen(matches, found), said[1], said[2], said[3])


@inner_kernel
def _seen(matches: PackedMatches, found: Found) -> Seen:
    """The matches as the pose sees them."""
    spread, tail = matches.spread, matches.tail
    return Seen(matches.pairs, matches.prior, found.R, found.t, found.mixture, spread, tail)


@inner_kernel
def _refine(matches: PackedMatches, precision: float, found: Found, normal: np.ndarray) -> float:
    """As `refinement.refine_pose`, by what the pose as it was makes plausible of the matches.

    Again where it ends at a pose that some of them made, and from which they lie too far away.
    """
    pose = Pose(found.R, found.t, found.mixture, normal, scratch(1))
    for _ in range(MAX_ROUNDS):
        end = _plausible(matches, found)
        refine_pose(matches, precision, MAX_REFINEMENTS, pose)
        _explain(matches, found)
        if not _beyond(end, found.said[2], found.said[3]):
            break
    return pose.cost[0]


@inner_kernel
def _plausible(matches: PackedMatches, found: Found) -> float:
    """As `plausible.plausible_parallax`, of all matches alike."""
    _leave_out_none(matches.prior, matches.total)
    _explain(matches, found)
    parallax, right, sigma = found.said[2], found.said[3], math.sqrt(found.mixture[0])
    return plausible_parallax(parallax, right, matches.total, sigma, matches.spread, matches.prior)


@inner_kernel
def _beyond(end: float, parallax: np.ndarray, right: np.ndarray) -> int:
    """Right matches of more parallax."""
    count = 0
    for i in range(right.size):
        count += 1 if right[i] > 0.5 and parallax[i] > end else 0
    return count


@inner_kernel
def _conclude(
    searched: PackedMatches, matches: PackedMatches, least_signal: float, grows: bool, found: Found
) -> Numbers:
    """Refine the pose once more, now that its noise is known, and hear all matches on it."""
    normal = scratch(6, 6)
    cost = _refine(matches, FINE, found, normal)
    predicted, shows = _be_sure(matches, least_signal, found)
    parallax, right = found.said[2], found.said[3]
    sigma, wrong = math.sqrt(found.mixture[0]), found.mixture[1]
    agreeing, odds, likelier = weigh(parallax, right, sigma, wrong, found.labels)
    beyond, supporting = _count_beyond(searched, right, matches.total, found)
    alike, likeness, effect = tell_sharing(
        matches.pairs, found.said[1], right, matches.total, sigma
    )
    return (
        cost,
        narrowness(normal),
        agreeing,
        odds,
        likelier,
        beyond,
        supporting,
        predicted,
        shows,
        grows,
        alike,
        likeness,
        effect,
    )


@inner_kernel
def _be_sure(matches: PackedMatches, least_signal: float, found: Found) -> tuple[bool, bool]:
    """Covariance of the pose; where much of the flow is noise, by predicted flow, as is the pose.

    Returns whether it was predicted, and whether at least so much of it is signal.
    """
    right = 0.0
    for i in range(matches.total):
        right += found.said[3, i]
    seen, covariance = _seen(matches, found), found.covariance
    if covariance_here(seen, right, MEASURED, PLAIN, covariance):
        return False, True
    step_by_prediction(seen)
    _explain(matches, found)
    return True, covariance_here(seen, right, PREDICTED, least_signal, covariance)


@inner_kernel
def _count_beyond(
    searched: PackedMatches, right: np.ndarray, count: int, found: Found
) -> tuple[int, int]:
    """Of the right matches searched, those that no rotation explains, and all."""
    for j in range(searched.prior.size):
        is_right = j < searched.total and right[j * count // searched.total] > 0.5
        searched.prior[j] = 1.0 if is_right else 0.0
    # A pose may take some of the flow: a match is off a rotation by twice what its noise would do.
    distance = 2.0 * NEAR_SIGMA * math.sqrt(mean_variance(found.mixture[0], found.mixture[2]))
    return count_beyond_rotation(searched.pairs, searched.prior, found.R, found.R_far, distance)
