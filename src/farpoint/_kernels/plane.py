"""Second motion of a plane, and the log-likelihood ratio of both motions by the plane's relief.

Two motions have the same homography of a plane (Longuet-Higgins, Proc. R. Soc. B 223, 1984, DOI
10.1098/rspb.1984.0088). Residuals do not contain the noise along the epipolar lines, and the two
motions have different epipolar lines. The log likelihoods of the two motions therefore differ by
chance, by about sqrt(N) for N matches. The relief of the plane distinguishes the motions: relief
displaces points from the positions that the plane predicts, and only along the epipolar lines of
the true motion.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.ambiguous_motions import second_planar_motion
from farpoint._kernels.arrays import clear, copy
from farpoint._kernels.compile import inlined_kernel, inner_kernel, kernel, step_kernel, sum_kernel
from farpoint._kernels.constants import (
    COARSE_TOLERANCE,
    EM_ROUNDS,
    GATE_SIGMA,
    LANES,
    MAX_ITERATIONS,
    MEDIAN_SQUARE,
    OFF_PLANE_MATCHES,
    OFF_PLANE_PRIOR_MATCHES,
    PANEL,
    RELIEF_PRIOR_MATCHES,
)
from farpoint._kernels.exponential import exp_and_roots, lane_log
from farpoint._kernels.hypothesis_comparison import is_same_mode, planar_margin
from farpoint._kernels.likelihood import evaluate_pose, evaluate_residuals
from farpoint._kernels.linear import add, add_outer
from farpoint._kernels.mixture import clutter_at, clutter_of, densities, sum_of
from farpoint._kernels.normal_equations import solve_three_spd
from farpoint._kernels.pairs import address, flow_variance, noise0, noise1, ray0, ray1
from farpoint._kernels.parallax_prior import kth_largest
from farpoint._kernels.pose import LinearisationPoint, PackedMatches, Pose
from farpoint._kernels.refinement import refine_pose
from farpoint._kernels.scalars import where
from farpoint._kernels.vectors import (
    Matrix,
    Vector,
    axpby,
    cross,
    dot,
    matrix,
    rotate,
    rotate_back,
    vector,
)

__all__ = ["other_motion"]


@kernel
def other_motion(
    matches: PackedMatches, pose: Pose, other: Pose, is_given: bool
) -> tuple[bool, float]:
    """Whether the second motion of a plane competes, and the log-likelihood ratio to this motion.

    The ratio is that of ``pose`` to the second motion, by the relief of the plane. ``other``
    receives the second motion and its noise parameters, and is undefined if there is no second
    motion. ``pose`` is not changed. If covariances were given for each match (``is_given``), the
    size of the covariances is used, but not their shape, because the errors of tracks have another
    shape.
    """
    count = matches.total
    gate = GATE_SIGMA * math.sqrt(pose.mixture[0])
    other_R, other_t = np.empty((3, 3)), np.empty(3)
    if not second_planar_motion(matches.pairs, count, gate, pose.R, pose.t, other_R, other_t):
        return False, 0.0
    own = Pose(np.empty((3, 3)), np.empty(3), np.empty(4), np.empty((6, 6)), np.empty(1))
    _set_pose(own, pose.R, pose.t, pose.mixture)
    refine_pose(matches, COARSE_TOLERANCE, MAX_ITERATIONS, own)
    _set_pose(other, other_R, other_t, pose.mixture)
    refine_pose(matches, COARSE_TOLERANCE, MAX_ITERATIONS, other)
    if is_same_mode(other.R, other.t, own):
        # The refinement of the second motion has converged to ``own``: the second motion is by
        # chance no local maximum, but may have nearly the same likelihood. The second motion is
        # therefore evaluated without refinement.
        _set_pose(other, other_R, other_t, own.mixture)
        other.cost[0] = evaluate_pose(matches, other, np.empty(4))
    is_near = other.cost[0] < own.cost[0] + planar_margin(count)
    if not is_near or is_same_mode(other.R, other.t, own):
        return False, 0.0
    return True, _log_ratio(matches, pose, other, is_given)


@inner_kernel
def _set_pose(pose: Pose, R: np.ndarray, t: np.ndarray, mixture: np.ndarray) -> None:
    """Set rotation, direction and mixture of a pose."""
    copy(R, pose.R)
    copy(t, pose.t)
    copy(mixture, pose.mixture)


@step_kernel
def _log_ratio(matches: PackedMatches, pose: Pose, other: Pose, is_given: bool) -> float:
    """Log-likelihood ratio of two motions by the relief, with EM of relief and noise.

    The ratio is averaged over two planes, one fitted with each motion. The fit with one motion
    absorbs noise along the epipolar lines of this motion, and therefore favours this motion.
    """
    pairs, prior, mixture, evidence = matches.pairs, matches.prior, pose.mixture, 0.0
    half_width, long_tail = matches.outlier_half_width, matches.long_tail
    off, parts = np.empty(3 * matches.total), np.empty(2 * matches.prior.size)
    clear(parts)
    for k in range(2):
        planar = pose if k == 0 else other
        point = LinearisationPoint(pairs, prior, planar.R, planar.t, mixture, half_width, long_tail)
        _plane_offsets(point, matches.total, off)
        _decompose(matches, planar.R, pose.t, is_given, off, parts)
        evidence += 0.5 * _log_likelihood(pose, matches, parts, mixture)
        _decompose(matches, planar.R, other.t, is_given, off, parts)
        evidence -= 0.5 * _log_likelihood(other, matches, parts, mixture)
    return evidence


@inner_kernel
def _log_likelihood(
    pose: Pose, matches: PackedMatches, parts: np.ndarray, mixture: np.ndarray
) -> float:
    """Log likelihood of the offsets from the plane (`_decompose`) under one motion.

    A match belongs to one of three classes. A match in the plane has an offset across its epipolar
    line, with the variance of the noise, and an offset along this line, with the variance of noise
    plus relief. A match off the plane lies anywhere on its epipolar line. All other matches are
    outliers. EM estimates the share of matches off the plane and both variances. The variance along
    the lines is at least the variance across the lines. If both variances are equal, all motions
    have the same likelihood.
    """
    # Density along the epipolar line of a match in the plane, at the position that the plane
    # predicts, divided by the density of a match that is uniform along the line.
    half_width, long_tail = matches.outlier_half_width, matches.long_tail
    peak = 2.0 * half_width / math.sqrt(2.0 * math.pi * mixture[0])
    point = LinearisationPoint(
        matches.pairs, matches.prior, pose.R, pose.t, mixture, half_width, long_tail
    )
    relief, sums, likelihood = np.empty(3), np.empty(5), -math.inf
    across, along, off_share = 1.0, 1.0, OFF_PLANE_MATCHES / OFF_PLANE_PRIOR_MATCHES
    for _ in range(EM_ROUNDS):
        relief[0], relief[1], relief[2] = across, along, off_share
        before, likelihood = likelihood, _relief_log_likelihood(point, parts, peak, relief, sums)
        if abs(likelihood - before) < COARSE_TOLERANCE:
            break
        on_line, off_plane, weight = (
            OFF_PLANE_PRIOR_MATCHES + sums[0],
            OFF_PLANE_MATCHES + sums[1],
            sums[2],
        )
        squares_across, squares_along = sums[3], sums[4]
        across = (squares_across + RELIEF_PRIOR_MATCHES) / (weight + RELIEF_PRIOR_MATCHES)
        along = squares_along / max(weight, 1.0)
        if along < across:
            along = (squares_across + squares_along + RELIEF_PRIOR_MATCHES) / (
                2.0 * weight + RELIEF_PRIOR_MATCHES
            )
            across = along
        off_share = off_plane / on_line
    return likelihood


@sum_kernel
def _relief_log_likelihood(
    point: LinearisationPoint, parts: np.ndarray, peak: float, relief: np.ndarray, sums: np.ndarray
) -> float:
    """One EM evaluation of `_log_likelihood`, by the squared offsets of `_decompose`.

    ``relief`` (3,) holds the variances across and along the lines, in units of the noise variance,
    and the share of matches off the plane. ``peak`` is the density of a match in the plane divided
    by the density of a uniform match. ``sums`` (5,) receives the expected numbers of all inliers,
    of inliers off the plane, and of core inliers in the plane, and two sums over the core inliers
    in the plane: of the squared offsets across and along the lines.
    """
    pairs, prior, variance, tail_share = (
        point.pairs,
        point.prior,
        point.mixture[0],
        point.mixture[2],
    )
    rotation, direction = matrix(point.R), vector(point.t)
    across, along, off_share = relief[0], relief[1], relief[2]
    # The density of outliers is the same for both motions; filler has prior 0.
    clutter, _ = clutter_at(clutter_of(point.mixture, point.outlier_half_width), 0.0)
    precision, scale = 1.0 / (variance * across), 1.0 / math.sqrt(across)
    highest = (1.0 - off_share) * peak / math.sqrt(along)
    likelihood = on_line = off_plane = about_it = squares_across = squares_along = 0.0
    for panel in range(prior.size // LANES):
        for lane in range(LANES):
            i, at = panel * LANES + lane, panel * PANEL + lane
            across2, along2 = parts[i], parts[prior.size + i]
            residual = math.sqrt(across2 * variance)
            each = densities(
                pairs,
                at,
                rotation,
                direction,
                residual,
                precision,
                tail_share,
                prior[i] * scale,
                point.long_tail,
            )
            core, _, _, _ = each
            whole = sum_of(each)
            near, _, _, _ = exp_and_roots(0.5 * along2 / along)
            about = highest * near
            density = whole * (off_share + about) + clutter
            over = 1.0 / density
            likelihood += lane_log(density)
            on_line += whole * (off_share + about) * over
            off_plane += whole * off_share * over
            w = core * about * over
            about_it += w
            squares_across += w * across2
            squares_along += w * along2
    sums[0], sums[1], sums[2] = on_line, off_plane, about_it
    sums[3], sums[4] = squares_across, squares_along
    return likelihood


@inner_kernel
def _decompose(
    matches: PackedMatches,
    R: np.ndarray,
    t: np.ndarray,
    is_given: bool,
    off: np.ndarray,
    parts: np.ndarray,
) -> None:
    """Squared offsets ``parts`` from the plane: across the epipolar lines, then along the lines.

    Each square is divided by the variance of the offset. From the offset along a line, the part
    that is correlated with the offset across the line is subtracted first. For any shape of the
    noise, the sum of the two squares does not depend on the direction ``t``.
    """
    rotation, direction = matrix(R), vector(t)
    for i in range(matches.total):
        at, away = address(i), (off[3 * i], off[3 * i + 1], off[3 * i + 2])
        b = ray1(matches.pairs, at)
        line = axpby(1.0, direction, -dot(direction, b), b)
        aside = cross(line, b)
        by_line = _noise_times(matches.pairs, at, rotation, is_given, line)
        by_aside = _noise_times(matches.pairs, at, rotation, is_given, aside)
        # ``line`` and ``aside`` are perpendicular to the ray b. ``away`` is the offset, rotated
        # about b by 90 degrees.
        x, y = dot(away, line), -dot(away, aside)
        variance = dot(aside, by_aside) + 1e-300
        shared = dot(aside, by_line) / variance
        parts[i] = x * x / variance
        along = y - shared * x
        own = max(dot(line, by_line) - shared * shared * variance, 0.0) + 1e-300
        parts[matches.prior.size + i] = along * along / own


@inlined_kernel
def _noise_times(pairs: np.ndarray, at: int, R: Matrix, is_given: bool, v: Vector) -> Vector:
    """Covariance of the flow ``b - R a`` for a noise sigma of 1, times ``v`` perpendicular to b."""
    size = where(is_given, flow_variance(pairs, at), 0.0)
    shape = where(is_given, 0.0, 1.0)
    first, second = rotate(R, noise0(pairs, at, rotate_back(R, v))), noise1(pairs, at, v)
    return axpby(size, v, shape, axpby(1.0, first, 1.0, second))


@step_kernel
def _plane_offsets(point: LinearisationPoint, count: int, off: np.ndarray) -> None:
    """Offsets ``off`` (3 N,) of the rays in camera 1 from their prediction by a fitted plane.

    The fit is robust. Offsets are in rad, divided by the noise sigma, and are rotated about the ray
    by 90 degrees. The plane is ``n . X = 1`` in the axes of camera 0; the unit of length is the
    length of the translation. This plane moves a ray a to ``R a + t (n . a)``.
    """
    size = point.prior.size
    inlier, square, spare, sizes = np.empty(size), np.empty(size), np.empty(size), np.empty(count)
    evaluate_residuals(point, square, spare, inlier)
    M, v, n = np.empty((3, 3)), np.empty(3), np.empty(3)
    rotation, direction, variance = matrix(point.R), vector(point.t), point.mixture[0]
    clear(square)
    typical = MEDIAN_SQUARE
    for _ in range(EM_ROUNDS):
        clear(M)
        clear(v)
        for i in range(count):
            _add_to_plane(point.pairs, i, rotation, direction, inlier, square, typical, M, v)
        _solve(M, v, variance, n)
        for i in range(count):
            square[i] = _write_offset(point.pairs, i, rotation, direction, variance, n, off)
        typical = max(_median(square, inlier, sizes), MEDIAN_SQUARE)


@inlined_kernel
def _apart(pairs: np.ndarray, at: int, R: Matrix, t: Vector) -> tuple[Vector, Vector, Vector]:
    """Ray a of a match, and cross products of ray b in camera 1 with ``R a`` and with ``t``.

    For short flow, cross products of rays are more accurate than differences of rays.
    """
    a, b = ray0(pairs, at), ray1(pairs, at)
    return a, cross(b, rotate(R, a)), cross(b, t)


@step_kernel
def _add_to_plane(
    pairs: np.ndarray,
    i: int,
    R: Matrix,
    t: Vector,
    inlier: np.ndarray,
    square: np.ndarray,
    typical: float,
    M: np.ndarray,
    v: np.ndarray,
) -> None:
    """Add a match to the normal equations of the plane, with a robust weight."""
    a, still, moved = _apart(pairs, address(i), R, t)
    discount = 1.0 + square[i] / (9.0 / MEDIAN_SQUARE * typical)
    precision = 1.0 / (discount * discount * flow_variance(pairs, address(i)))
    weight = where(inlier[i] > 0.5, precision, 0.0)
    add_outer(a, a, weight * dot(moved, moved), M)
    add(-weight * dot(moved, still), a, v)


@inlined_kernel
def _solve(M: np.ndarray, v: np.ndarray, variance: float, n: np.ndarray) -> None:
    """Solve for the plane. If n is underdetermined, damping selects the n of least length."""
    damping = 1e-9 * (M[0, 0] + M[1, 1] + M[2, 2]) + 1e-300 * variance
    for k in range(3):
        M[k, k] += damping
    solve_three_spd(M, v, 0.0, n)


@step_kernel
def _write_offset(
    pairs: np.ndarray,
    i: int,
    R: Matrix,
    t: Vector,
    variance: float,
    n: np.ndarray,
    off: np.ndarray,
) -> float:
    """Write the offset ``off`` of a match from the plane.

    The function returns the squared offset divided by the variance of the offset.
    """
    a, still, moved = _apart(pairs, address(i), R, t)
    over = 1.0 / math.sqrt(variance)
    away = axpby(over, still, over * dot(vector(n), a), moved)
    off[3 * i], off[3 * i + 1], off[3 * i + 2] = away
    return dot(away, away) / flow_variance(pairs, address(i))


@step_kernel
def _median(square: np.ndarray, inlier: np.ndarray, sizes: np.ndarray) -> float:
    """Median of the squares of inliers; 0 without inliers. ``sizes`` (count,) is a buffer."""
    consistent = 0
    for i in range(sizes.size):
        is_right = inlier[i] > 0.5
        sizes[i] = square[i] if is_right else -1.0
        consistent += 1 if is_right else 0
    return kth_largest(sizes, (consistent + 1) // 2)
