"""The other motion that a plane allows, and whether anything off the plane tells the two apart.

Two motions move the points of a plane alike (Longuet-Higgins, Proc. R. Soc. B 223, 1984,
DOI 10.1098/rspb.1984.0088). Their likelihoods differ all the same, by chance: each leaves free
where a match lies along its own epipolar line, and so counts another part of the same noise. Over N
matches that makes a difference of about sqrt(N), which says nothing. What says something are points
off the plane, and by how much the others are nearer or farther than it.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inner_kernel, kernel
from farpoint._kernels.contest import GATE_SIGMA
from farpoint._kernels.formulas import choose, formula, greater, root
from farpoint._kernels.likelihood import explain, refine_pose
from farpoint._kernels.linear import add, add_outer
from farpoint._kernels.mixture import clutter_density
from farpoint._kernels.motion import MAX_REFINEMENTS
from farpoint._kernels.pairs import address, flow_variance, ray0, ray1
from farpoint._kernels.pose import Matches, Pose, Seen
from farpoint._kernels.scratch import clear, copy, room, scratch
from farpoint._kernels.squares import solve_three_spd
from farpoint._kernels.twins import planar_twin
from farpoint._kernels.vectors import Matrix, Vector, combine, cross, dot, matrix, rotate, vector

__all__ = ["other_motion"]

# Log likelihood that the other motion may lack: more than the chance of so many matches makes. That
# grows with the root of their number, and so does what chance makes of the evidence.
RIVAL = 40.0
OF_MATCHES = 160.0
FINE = 0.1
# Two directions as close as this are one minimum.
COS_SAME = math.cos(math.radians(10.0))
# Squared distance from the plane, in units of the noise, at which a match is off it.
OFF_SQUARE = 4.0**2
PLANE_ROUNDS = 8
# Median of the sum of the squares of two normal errors.
MEDIAN = 2.0 * math.log(2.0)


@kernel
def other_motion(matches: Matches, pose: Pose, other: Pose) -> tuple[bool, float]:
    """Whether another motion is a rival, and by how much the log likelihood of this one is larger.

    As far as that is not chance. ``other`` receives the rival, with the noise that it needs;
    without one it has no meaning. ``pose`` stays as it is.
    """
    count = matches.total
    gate = GATE_SIGMA * math.sqrt(pose.mixture[0])
    if not planar_twin(matches.pairs, count, gate, pose.R, pose.t, other.R, other.t):
        return False, 0.0
    own = Pose(scratch(3, 3), scratch(3), scratch(3), scratch(6, 6), scratch(1))
    copy(pose.R, own.R)
    copy(pose.t, own.t)
    copy(pose.mixture, own.mixture)
    copy(pose.mixture, other.mixture)
    refine_pose(matches, FINE, MAX_REFINEMENTS, own)
    refine_pose(matches, FINE, MAX_REFINEMENTS, other)
    growth = math.sqrt(greater(count / OF_MATCHES, 1.0))
    is_near = other.cost[0] < own.cost[0] + growth * RIVAL
    if not is_near or dot(vector(pose.t), vector(other.t)) > COS_SAME:
        return False, 0.0
    return True, _evidence(matches, pose, other) / growth


@inner_kernel
def _evidence(matches: Matches, pose: Pose, other: Pose) -> float:
    """Log likelihood of the first motion over the other, but for what chance makes of it.

    Both with the noise of the first. Of a match at the distance z from the plane, both in units of
    the noise, the part that depends on which line it left the plane along has the weight
    ``z^2 / (1 + z^2)``: nothing on the plane, all off it. Near it, the weight is that of a typical
    match, less what chance makes of that.
    """
    pairs, prior, count, mixture = matches.pairs, matches.prior, matches.total, pose.mixture
    size = prior.size
    right, other_right, square, spare = room(size), room(size), room(size), room(size)
    clutter = clutter_density(mixture[0], mixture[1], matches.spread)
    # Nobody asks for residual and parallax.
    by_other = Seen(pairs, prior, other.R, other.t, mixture, clutter)
    explain(by_other, square, spare, other_right)
    explain(Seen(pairs, prior, pose.R, pose.t, mixture, clutter), square, spare, right)
    _measure(pairs, count, mixture[0], pose.R, pose.t, right, square, spare)
    weight = _weight_near(*_median(square, right, count, OFF_SQUARE, spare))
    evidence = 0.0
    for i in range(count):
        gain = math.log((1.0 - other_right[i]) / (1.0 - right[i]))
        evidence += gain if square[i] > OFF_SQUARE else weight * gain
    return evidence


@formula
def _weight_near(median: float, count: float) -> float:
    """Of what so many matches near the plane say; the median of their squared distances."""
    excess = median / MEDIAN * (1.0 - 1.0 / root(greater(count, 1.0))) - 1.0
    distance2 = greater(2.0 * excess, 0.0)
    return distance2 / (1.0 + distance2)


@inner_kernel
def _measure(
    pairs: np.ndarray,
    count: int,
    variance: float,
    R: np.ndarray,
    t: np.ndarray,
    right: np.ndarray,
    square: np.ndarray,
    spare: np.ndarray,
) -> None:
    """Squared distances of the later rays from where the plane through most would have them.

    In units of the noise, over both of its coordinates. The plane ``n . X = 1`` (camera 0, unit of
    the translation) moves a ray a to ``R a + t (n . a)``. ``spare`` is room for as many.
    """
    M, v, n = scratch(3, 3), scratch(3), scratch(3)
    turn, towards = matrix(R), vector(t)
    clear(square)
    typical = MEDIAN
    for _ in range(PLANE_ROUNDS):
        clear(M)
        clear(v)
        for i in range(count):
            _add_to_plane(pairs, i, turn, towards, right, square, typical, M, v)
        _solve(M, v, variance, n)
        for i in range(count):
            square[i] = _square_from(pairs, i, turn, towards, variance, n)
        median, _ = _median(square, right, count, math.inf, spare)
        typical = greater(median, MEDIAN)


@formula
def _apart(pairs: np.ndarray, at: int, R: Matrix, t: Vector) -> tuple[Vector, Vector, Vector]:
    """Ray a of a match and, across the later ray b, where ``R a`` is and where ``t`` leads.

    As products with b, whose lengths are exact where differences of ones would not be.
    """
    a, b = ray0(pairs, at), ray1(pairs, at)
    return a, cross(b, rotate(R, a)), cross(b, t)


@formula
def _add_to_plane(
    pairs: np.ndarray,
    i: int,
    R: Matrix,
    t: Vector,
    right: np.ndarray,
    square: np.ndarray,
    typical: float,
    M: np.ndarray,
    v: np.ndarray,
) -> None:
    """Add a match to the normal equations of the plane, the less the farther off that was."""
    a, still, moved = _apart(pairs, address(i), R, t)
    doubt = 1.0 + square[i] / (9.0 / MEDIAN * typical)
    precision = 1.0 / (doubt * doubt * flow_variance(pairs, address(i)))
    weight = choose(right[i] > 0.5, precision, 0.0)
    add_outer(a, a, weight * dot(moved, moved), M)
    add(-weight * dot(moved, still), a, v)


@formula
def _solve(M: np.ndarray, v: np.ndarray, variance: float, n: np.ndarray) -> None:
    """The plane; where the rays fix none, the farthest of those they allow."""
    damping = 1e-9 * (M[0, 0] + M[1, 1] + M[2, 2]) + 1e-300 * variance
    for k in range(3):
        M[k, k] += damping
    solve_three_spd(M, v, 0.0, n)


@formula
def _square_from(
    pairs: np.ndarray, i: int, R: Matrix, t: Vector, variance: float, n: np.ndarray
) -> float:
    """Squared distance from where the plane has the match."""
    a, still, moved = _apart(pairs, address(i), R, t)
    left = combine(1.0, still, dot(vector(n), a), moved)
    return dot(left, left) / (variance * flow_variance(pairs, address(i)))


@inner_kernel
def _median(
    square: np.ndarray, right: np.ndarray, count: int, most: float, found: np.ndarray
) -> tuple[float, float]:
    """Median of the squares of right matches up to ``most``, and of how many; 0 of none.

    ``found`` is room for these, which are sorted as they come: they are few.
    """
    taken = 0
    for i in range(count):
        value = square[i]
        if right[i] > 0.5 and value <= most:
            j = taken
            while j > 0 and found[j - 1] > value:
                found[j] = found[j - 1]
                j -= 1
            found[j] = value
            taken += 1
    if taken == 0:
        return 0.0, 0.0
    return 0.5 * (found[(taken - 1) // 2] + found[taken // 2]), float(taken)
