"""The other motion that a plane allows, and whether anything off the plane tells the two apart.

Two motions move the points of a plane alike (Longuet-Higgins, Proc. R. Soc. B 223, 1984,
DOI 10.1098/rspb.1984.0088). Their likelihoods differ all the same, by chance: each leaves free
where a match lies along its own epipolar line, and so counts another part of the same noise. Over N
matches that makes a difference of about sqrt(N), which says nothing. What says something is the
plane's relief: it moves points along the epipolar lines of the right motion, and of no other one.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.arrays import clear, copy
from farpoint._kernels.compile import inlined_kernel, inner_kernel, kernel, step_kernel, sum_kernel
from farpoint._kernels.contest import GATE_SIGMA, is_same, near_of_plane
from farpoint._kernels.exponential import exp_and_roots, lane_log
from farpoint._kernels.likelihood import explain, judge_pose
from farpoint._kernels.linear import add, add_outer
from farpoint._kernels.mixture import clutter_at, clutter_of, densities, sum_of
from farpoint._kernels.pairs import LANES, PANEL, address, flow_variance, noise0, noise1, ray0, ray1
from farpoint._kernels.plausible import largest
from farpoint._kernels.pose import PackedMatches, Pose, Seen
from farpoint._kernels.refinement import refine_pose
from farpoint._kernels.scalars import where
from farpoint._kernels.settling import MAX_REFINEMENTS
from farpoint._kernels.squares import solve_three_spd
from farpoint._kernels.twins import planar_twin
from farpoint._kernels.vectors import (
    Matrix,
    Vector,
    combine,
    cross,
    dot,
    matrix,
    rotate,
    rotate_back,
    vector,
)

__all__ = ["other_motion"]

# Log likelihood to which motions are refined, and relief is.
FINE = 0.1
# Matches that lie anywhere on their lines, and not about the plane, of so many: as much is believed
# before any is seen. A wrong match or two lie on the lines of any motion.
OFF, OF_ALL = 4.0, 40.0
# Matches whose noise counts as much as what was found of it before.
KNOWN = 60.0
PLANE_ROUNDS = 8
RELIEF_ROUNDS = 8
# Median of the sum of the squares of two normal errors.
MEDIAN = 2.0 * math.log(2.0)


@kernel
def other_motion(
    matches: PackedMatches, pose: Pose, other: Pose, is_told: bool
) -> tuple[bool, float]:
    """Whether another motion is a rival, and by how much the log likelihood of this one is larger.

    As far as that is not chance. ``other`` receives the rival, with the noise that it needs;
    without one it has no meaning. ``pose`` stays as it is. Of noise that is told match by match,
    only the size is heard: what has shaped it shapes the errors of tracks otherwise.
    """
    count = matches.total
    gate = GATE_SIGMA * math.sqrt(pose.mixture[0])
    twin_R, twin_t = np.empty((3, 3)), np.empty(3)
    if not planar_twin(matches.pairs, count, gate, pose.R, pose.t, twin_R, twin_t):
        return False, 0.0
    own = Pose(np.empty((3, 3)), np.empty(3), np.empty(4), np.empty((6, 6)), np.empty(1))
    _put(own, pose.R, pose.t, pose.mixture)
    refine_pose(matches, FINE, MAX_REFINEMENTS, own)
    _put(other, twin_R, twin_t, pose.mixture)
    refine_pose(matches, FINE, MAX_REFINEMENTS, other)
    if is_same(other.R, other.t, own):
        # By chance there may be no minimum. The matches are explained as well for all that.
        _put(other, twin_R, twin_t, own.mixture)
        other.cost[0] = judge_pose(matches, other, np.empty(4))
    is_near = other.cost[0] < own.cost[0] + near_of_plane(count)
    if not is_near or is_same(other.R, other.t, own):
        return False, 0.0
    return True, _evidence(matches, pose, other, is_told)


@inner_kernel
def _put(pose: Pose, R: np.ndarray, t: np.ndarray, mixture: np.ndarray) -> None:
    """Make the pose this one."""
    copy(R, pose.R)
    copy(t, pose.t)
    copy(mixture, pose.mixture)


@step_kernel
def _evidence(matches: PackedMatches, pose: Pose, other: Pose, is_told: bool) -> float:
    """Log likelihood of the first motion over the other, whatever the relief and the noise.

    By the plane of either in turn: what one has explained of the noise, it has for its own motion.
    """
    pairs, prior, mixture, evidence = matches.pairs, matches.prior, pose.mixture, 0.0
    spread, tail = matches.spread, matches.tail
    off, parts = np.empty(3 * matches.total), np.empty(2 * matches.prior.size)
    clear(parts)
    for k in range(2):
        planar = pose if k == 0 else other
        seen = Seen(pairs, prior, planar.R, planar.t, mixture, spread, tail)
        _measure(seen, matches.total, off)
        _part(matches, planar.R, pose.t, is_told, off, parts)
        evidence += 0.5 * _likelihood_by(pose, matches, parts, mixture)
        _part(matches, planar.R, other.t, is_told, off, parts)
        evidence -= 0.5 * _likelihood_by(other, matches, parts, mixture)
    return evidence


@inner_kernel
def _likelihood_by(
    pose: Pose, matches: PackedMatches, parts: np.ndarray, mixture: np.ndarray
) -> float:
    """Log likelihood of how far matches are off the plane, by a motion, from what `_part` says.

    A match is about the plane, off by the noise and, along its epipolar line, by the relief; or
    anywhere on that line; or wrong. The share of those anywhere and the variances across the line
    and along it are found by EM, the latter no smaller than the former. Where they are alike, so is
    all that is said by any motion.
    """
    # Density on a line of a match about the plane, at its place, over that of one anywhere.
    spread, tail = matches.spread, matches.tail
    peak = 2.0 * spread / math.sqrt(2.0 * math.pi * mixture[0])
    seen = Seen(matches.pairs, matches.prior, pose.R, pose.t, mixture, spread, tail)
    relief, sums, likelihood = np.empty(3), np.empty(5), -math.inf
    across, along, off_share = 1.0, 1.0, OFF / OF_ALL
    for _ in range(RELIEF_ROUNDS):
        relief[0], relief[1], relief[2] = across, along, off_share
        before, likelihood = likelihood, _hear(seen, parts, peak, relief, sums)
        if abs(likelihood - before) < FINE:
            break
        on_line, off_plane, weight = OF_ALL + sums[0], OFF + sums[1], sums[2]
        squares_across, squares_along = sums[3], sums[4]
        across = (squares_across + KNOWN) / (weight + KNOWN)
        along = squares_along / max(weight, 1.0)
        if along < across:
            along = (squares_across + squares_along + KNOWN) / (2.0 * weight + KNOWN)
            across = along
        off_share = off_plane / on_line
    return likelihood


@sum_kernel
def _hear(
    seen: Seen, parts: np.ndarray, peak: float, relief: np.ndarray, sums: np.ndarray
) -> float:
    """Log likelihood of `_likelihood_by`, by the squares of how far matches are off, as of `_part`.

    ``relief`` (3,) holds the variances across the lines and along them, over those of the noise,
    and the share of matches anywhere on their lines; ``peak`` is the density of one about the plane
    over that of one anywhere. ``sums`` (5,) receives the expected number of matches on their lines,
    of those of them that are off the plane, and of the others; and the squares of these across
    their lines and along them.
    """
    pairs, prior, variance, poor = seen.pairs, seen.prior, seen.mixture[0], seen.mixture[2]
    turn, towards = matrix(seen.R), vector(seen.t)
    across, along, off_share = relief[0], relief[1], relief[2]
    # Wrong matches speak for neither, wherever they lie, nor do those that fill up the panels.
    clutter, _ = clutter_at(clutter_of(seen.mixture, seen.spread), 0.0)
    precision, likeness = 1.0 / (variance * across), 1.0 / math.sqrt(across)
    highest = (1.0 - off_share) * peak / math.sqrt(along)
    likelihood = on_line = off_plane = about_it = squares_across = squares_along = 0.0
    for panel in range(prior.size // LANES):
        for lane in range(LANES):
            i, at = panel * LANES + lane, panel * PANEL + lane
            across2, along2 = parts[i], parts[prior.size + i]
            residual = math.sqrt(across2 * variance)
            each = densities(
                pairs, at, turn, towards, residual, precision, poor, prior[i] * likeness, seen.tail
            )
            good, _, _, _ = each
            whole = sum_of(each)
            near, _, _, _ = exp_and_roots(0.5 * along2 / along)
            about = highest * near
            density = whole * (off_share + about) + clutter
            over = 1.0 / density
            likelihood += lane_log(density)
            on_line += whole * (off_share + about) * over
            off_plane += whole * off_share * over
            w = good * about * over
            about_it += w
            squares_across += w * across2
            squares_along += w * along2
    sums[0], sums[1], sums[2] = on_line, off_plane, about_it
    sums[3], sums[4] = squares_across, squares_along
    return likelihood


@inner_kernel
def _part(
    matches: PackedMatches,
    R: np.ndarray,
    t: np.ndarray,
    is_told: bool,
    off: np.ndarray,
    parts: np.ndarray,
) -> None:
    """Squares ``parts`` of how far matches are off the plane: across their lines, then along them.

    Each over its variance; along a line, of what the noise across it does not tell of it. The two
    add up to the same towards any direction ``t``, however the noise of a match lies.
    """
    turn, towards = matrix(R), vector(t)
    for i in range(matches.total):
        at, away = address(i), (off[3 * i], off[3 * i + 1], off[3 * i + 2])
        b = ray1(matches.pairs, at)
        line = combine(1.0, towards, -dot(towards, b), b)
        aside = cross(line, b)
        by_line = _noise_times(matches.pairs, at, turn, is_told, line)
        by_aside = _noise_times(matches.pairs, at, turn, is_told, aside)
        # Both lie across the ray, and what is off is turned about it by a quarter.
        x, y = dot(away, line), -dot(away, aside)
        variance = dot(aside, by_aside) + 1e-300
        shared = dot(aside, by_line) / variance
        parts[i] = x * x / variance
        along = y - shared * x
        own = max(dot(line, by_line) - shared * shared * variance, 0.0) + 1e-300
        parts[matches.prior.size + i] = along * along / own


@inlined_kernel
def _noise_times(pairs: np.ndarray, at: int, R: Matrix, is_told: bool, v: Vector) -> Vector:
    """Covariance of the flow from ``R a`` to b, for unit noise, times ``v`` across b."""
    size = where(is_told, flow_variance(pairs, at), 0.0)
    shape = where(is_told, 0.0, 1.0)
    first, second = rotate(R, noise0(pairs, at, rotate_back(R, v))), noise1(pairs, at, v)
    return combine(size, v, shape, combine(1.0, first, 1.0, second))


@step_kernel
def _measure(seen: Seen, count: int, off: np.ndarray) -> None:
    """How far the later rays are ``off`` (3 N,) where the plane through most would have them.

    In rad over the sigma of the noise, and turned about the ray by a quarter. The plane
    ``n . X = 1`` (camera 0, unit of the translation) moves a ray a to ``R a + t (n . a)``.
    """
    size = seen.prior.size
    right, square, spare, sizes = np.empty(size), np.empty(size), np.empty(size), np.empty(count)
    explain(seen, square, spare, right)
    M, v, n = np.empty((3, 3)), np.empty(3), np.empty(3)
    turn, towards, variance = matrix(seen.R), vector(seen.t), seen.mixture[0]
    clear(square)
    typical = MEDIAN
    for _ in range(PLANE_ROUNDS):
        clear(M)
        clear(v)
        for i in range(count):
            _add_to_plane(seen.pairs, i, turn, towards, right, square, typical, M, v)
        _solve(M, v, variance, n)
        for i in range(count):
            square[i] = _put_off(seen.pairs, i, turn, towards, variance, n, off)
        typical = max(_median(square, right, sizes), MEDIAN)


@inlined_kernel
def _apart(pairs: np.ndarray, at: int, R: Matrix, t: Vector) -> tuple[Vector, Vector, Vector]:
    """Ray a of a match and, across the later ray b, where ``R a`` is and where ``t`` leads.

    As products with b, whose lengths are exact where differences of ones would not be.
    """
    a, b = ray0(pairs, at), ray1(pairs, at)
    return a, cross(b, rotate(R, a)), cross(b, t)


@step_kernel
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
    weight = where(right[i] > 0.5, precision, 0.0)
    add_outer(a, a, weight * dot(moved, moved), M)
    add(-weight * dot(moved, still), a, v)


@inlined_kernel
def _solve(M: np.ndarray, v: np.ndarray, variance: float, n: np.ndarray) -> None:
    """The plane; where the rays fix none, the farthest of those they allow."""
    damping = 1e-9 * (M[0, 0] + M[1, 1] + M[2, 2]) + 1e-300 * variance
    for k in range(3):
        M[k, k] += damping
    solve_three_spd(M, v, 0.0, n)


@step_kernel
def _put_off(
    pairs: np.ndarray,
    i: int,
    R: Matrix,
    t: Vector,
    variance: float,
    n: np.ndarray,
    off: np.ndarray,
) -> float:
    """Write down how far a match is ``off`` the plane; the square of it in units of its noise."""
    a, still, moved = _apart(pairs, address(i), R, t)
    over = 1.0 / math.sqrt(variance)
    away = combine(over, still, over * dot(vector(n), a), moved)
    off[3 * i], off[3 * i + 1], off[3 * i + 2] = away
    return dot(away, away) / flow_variance(pairs, address(i))


@step_kernel
def _median(square: np.ndarray, right: np.ndarray, sizes: np.ndarray) -> float:
    """Median of the squares of right matches; 0 of none. ``sizes`` (count,) is room for these."""
    agreeing = 0
    for i in range(sizes.size):
        is_right = right[i] > 0.5
        sizes[i] = square[i] if is_right else -1.0
        agreeing += 1 if is_right else 0
    return largest(sizes, (agreeing + 1) // 2)
