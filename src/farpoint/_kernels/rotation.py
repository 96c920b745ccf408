"""Rotation of direction vectors: residuals, consensus and refinement when translation is absent."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import kernel, sum_kernel
from farpoint._kernels.exponential import exp_and_roots, lane_log
from farpoint._kernels.formulas import formula, greater, lesser, root, sum_formula, whole
from farpoint._kernels.likelihood import POOR, update_mixture, weight_of
from farpoint._kernels.linear import add_outer, apply_rotation_step, draw_index, kabsch
from farpoint._kernels.pairs import (
    LANES,
    PANEL,
    address,
    flow_variance,
    noise0,
    noise1,
    ray0,
    ray1,
)
from farpoint._kernels.scratch import clear, copy, scratch
from farpoint._kernels.squares import FOUR, add_square, solve_three_spd, write_square
from farpoint._kernels.vectors import (
    Matrix,
    Vector,
    combine,
    cross,
    dot,
    matrix,
    rotate,
    rotate_back,
    tangent_columns,
)

__all__ = [
    "count_beyond",
    "enlarge_rotation",
    "explain_rotation",
    "refine_rotation",
    "rotation_distance2",
    "rotation_linearize",
    "search_rotation",
]


Row = tuple[float, float, float, float]


@formula
def _distance2(pairs: np.ndarray, at: int, R: Matrix) -> float:
    """``|b - R a|^2`` in units of the noise of one coordinate (isotropic)."""
    d = combine(1.0, ray1(pairs, at), -1.0, rotate(R, ray0(pairs, at)))
    return dot(d, d) / flow_variance(pairs, at)


@sum_kernel
def _truncated_squares(pairs: np.ndarray, R: np.ndarray, limit: float, best: float) -> float:
    """Sum of the squared distances from a rotation, each at most ``limit``.

    Returns early, with at least ``best``, what is no better.
    """
    turn = matrix(R)
    cost = 0.0
    for panel in range(pairs.size // PANEL):
        for lane in range(LANES):
            cost += lesser(_distance2(pairs, panel * PANEL + lane, turn), limit)
        if cost >= best:
            return cost
    return cost


@kernel
def search_rotation(
    pairs: np.ndarray,
    count: int,
    tolerance: float,
    max_iterations: int,
    state: np.ndarray,
    R: np.ndarray,
) -> int:
    """Consensus over rotations from three rays each (eqs. 7-13 of the paper); returns iterations.

    Minimises the truncated squares ``sum min(|b - R a|^2 / variance, tolerance^2)`` of the
    ``count`` matches. Stops when with 99.9 % one sample of consistent rays has been drawn. ``R``
    receives the best rotation.
    """
    limit = tolerance * tolerance
    hypothesis, M = scratch(3, 3), scratch(3, 3)
    best = math.inf
    needed = max_iterations
    iteration = 0
    while iteration < needed:
        iteration += 1
        clear(M)
        for _ in range(3):
            at = address(draw_index(state, count))
            add_outer(ray1(pairs, at), ray0(pairs, at), 1.0, M)
        if not kabsch(M, hypothesis):
            continue
        cost = _truncated_squares(pairs, hypothesis, limit, best)
        if cost < best:
            best = cost
            copy(hypothesis, R)
            share = 1.0 - best / (limit * count)
            miss = 1.0 - share * share * share
            if 1e-3 < miss < 1.0:
                needed = lesser(max_iterations, whole(math.log(1e-3) / math.log(miss)) + 1)
            elif miss <= 1e-3:
                break
    return iteration


@sum_kernel
def _correlate(pairs: np.ndarray, R: np.ndarray, limit: float, M: np.ndarray) -> float:
    """``M = sum b a^T / variance`` over the matches within ``limit`` of a rotation; their number.

    Those that fill up the panels agree with any rotation and weigh nothing.
    """
    turn = matrix(R)
    inside = 0.0
    sums = (0.0,) * 9
    for panel in range(pairs.size // PANEL):
        for lane in range(LANES):
            at = panel * PANEL + lane
            agrees = 1.0 if _distance2(pairs, at, turn) <= limit else 0.0
            inside += agrees
            weight = agrees / flow_variance(pairs, at)
            sums = _add_product(sums, weight, ray1(pairs, at), ray0(pairs, at))
    write_rows(sums, M)
    return inside


@sum_formula
def _add_product(sums: tuple, weight: float, b: Vector, a: Vector) -> tuple:
    """``sums + weight b a^T``, by rows."""
    terms = [weight * y * x for y in b for x in a]
    return tuple(so_far + term for so_far, term in zip(sums, terms, strict=True))


@formula
def write_rows(elements: tuple, M: np.ndarray) -> None:
    """Write a matrix (3, 3)."""
    for i, element in enumerate(elements):
        M[i // 3, i % 3] = element


@kernel
def enlarge_rotation(
    pairs: np.ndarray, count: int, tolerance: float, R: np.ndarray, consistent: np.ndarray
) -> int:
    """Enlarge the consistent set step by step, re-fitting after each; returns its size.

    The set grows from half the tolerance to all of it: a rotation from three noisy rays is off by
    about as much as the far points that it should recognise. ``consistent`` (count,) receives
    whether a match belongs to it; ``R`` is improved in place.
    """
    M = scratch(3, 3)
    filled_up = pairs.size // PANEL * LANES - count
    limit = tolerance * tolerance
    size = 0
    for step in range(12):
        previous = size
        part = lesser(1.0, 0.5 + 0.125 * step)
        within = limit * part * part
        size = whole(_correlate(pairs, R, within, M)) - filled_up
        if step > 4 and size == previous:
            break
        if size < 2 or not kabsch(M, R):
            break
    turn = matrix(R)
    for i in range(count):
        consistent[i] = _distance2(pairs, address(i), turn) <= limit
    return size


@formula
def _tangent_residual(
    pairs: np.ndarray, at: int, R: Matrix
) -> tuple[tuple, tuple, float, float, float, float, float]:
    """Basis ``E`` of the plane at ``b``, ``E^T (b - R a)``, its covariance for unit noise."""
    m, b = rotate(R, ray0(pairs, at)), ray1(pairs, at)
    d = combine(1.0, b, -1.0, m)
    first, second = tangent_columns(b)
    x, y = (
        combine(1.0, noise1(pairs, at, e), 1.0, rotate(R, noise0(pairs, at, rotate_back(R, e))))
        for e in (first, second)
    )
    return (
        first,
        second,
        dot(first, d),
        dot(second, d),
        dot(first, x),
        dot(second, x),
        dot(second, y),
    )


@formula
def _square(pairs: np.ndarray, at: int, R: Matrix) -> float:
    """Squared Mahalanobis distance of ``b`` from ``R a``."""
    _, _, z0, z1, s00, s01, s11 = _tangent_residual(pairs, at, R)
    return (s11 * z0 * z0 - 2.0 * s01 * z0 * z1 + s00 * z1 * z1) / (s00 * s11 - s01 * s01)


@formula
def _whitened(pairs: np.ndarray, at: int, R: Matrix) -> tuple[float, Row, Row]:
    """That distance, and Jacobian and residual in axes in which their noise is 1 and round."""
    first, second, z0, z1, s00, s01, s11 = _tangent_residual(pairs, at, R)
    m = rotate(R, ray0(pairs, at))
    # d(b - R a) = m x dtheta, so the rows of J = E^T [m]x are e x m.
    j, k = cross(first, m), cross(second, m)
    scale0, slope = 1.0 / root(s00), s01 / s00
    scale1 = 1.0 / root(s11 - slope * s01)
    u, v = scale0 * z0, scale1 * (z1 - slope * z0)
    rest = combine(scale1, k, -scale1 * slope, j)
    return u * u + v * v, (scale0 * j[0], scale0 * j[1], scale0 * j[2], u), (*rest, v)


@kernel
def rotation_distance2(pairs: np.ndarray, R: np.ndarray, out: np.ndarray) -> None:
    """Squared Mahalanobis distances ``out`` of ``b`` from ``R a``, in units of the noise.

    Two degrees of freedom each where translation is absent.
    """
    turn = matrix(R)
    for panel in range(out.size // LANES):
        for lane in range(LANES):
            out[panel * LANES + lane] = _square(pairs, panel * PANEL + lane, turn)


@sum_kernel
def count_beyond(pairs: np.ndarray, right: np.ndarray, R: np.ndarray, limit: float) -> float:
    """How many of the right matches (those of 1) have a squared distance beyond ``limit``."""
    turn = matrix(R)
    beyond = 0.0
    for panel in range(right.size // LANES):
        for lane in range(LANES):
            square = _square(pairs, panel * PANEL + lane, turn)
            beyond += right[panel * LANES + lane] if square > limit else 0.0
    return beyond


@formula
def _densities(
    square: float, precision: float, poor: float, prior: float
) -> tuple[float, float, float]:
    """Density of a match, if good, poor or poorer, over a good one's at 0, in two dimensions."""
    whole, eighth, last = exp_and_roots(0.5 * square * precision)
    once, again = 1.0 - poor, poor / (POOR * POOR)
    return (
        prior * (once * whole),
        prior * (once * again * eighth),
        prior * (again * again * last),
    )


@sum_kernel
def rotation_linearize(
    pairs: np.ndarray,
    prior: np.ndarray,
    R: np.ndarray,
    mixture: np.ndarray,
    clutter: float,
    H: np.ndarray,
    g: np.ndarray,
    sums: np.ndarray,
) -> float:
    """Robust cost, gradient ``g`` (3,) and Gauss-Newton matrix ``H`` (3, 3) without translation.

    As `likelihood.linearize` with the residual of two dimensions ``E^T (b - R a)`` on the tangent
    plane of ``b`` and its covariance ``E^T (S_b + R S_a R^T) E``. ``sums`` (4,) receives the
    expected number of right matches, of poor ones, of poorer ones, and the squares of good ones.
    """
    turn = matrix(R)
    precision, poor = 1.0 / mixture[0], mixture[2]
    cost = used = right = doubtful = poorest = 0.0
    normal = FOUR
    for panel in range(prior.size // LANES):
        for lane in range(LANES):
            at, share = panel * PANEL + lane, prior[panel * LANES + lane]
            square, row0, row1 = _whitened(pairs, at, turn)
            good, fair, bad = _densities(square, precision, poor, share)
            total = good + fair + bad + clutter
            over = 1.0 / total
            cost -= lane_log(total)
            used += 1.0 if share > 0.0 else 0.0
            right += (good + fair + bad) * over
            doubtful += (fair + bad) * over
            poorest += bad * over
            weight = precision * weight_of(good, fair, bad) * over
            normal = add_square(add_square(normal, weight, row0), weight, row1)
    sums[0], sums[1], sums[2], sums[3] = (
        right,
        doubtful,
        poorest,
        _write_normal(normal, H, g) / precision,
    )
    return cost + (prior.size - used) * lane_log(clutter)


@formula
def _write_normal(sums: tuple, H: np.ndarray, g: np.ndarray) -> float:
    """Write Gauss-Newton matrix and gradient; the sum of the squares."""
    write_square(sums[:6], H)
    g[0], g[1], g[2] = sums[6:9]
    return sums[9]


@kernel
def refine_rotation(
    pairs: np.ndarray,
    prior: np.ndarray,
    count: int,
    spread: float,
    min_variance: float,
    max_iterations: int,
    R: np.ndarray,
    mixture: np.ndarray,
    H: np.ndarray,
) -> float:
    """Maximum-likelihood rotation without translation; returns its cost.

    ``mixture`` (3,) holds the variance of good matches, the share of wrong ones among all ``count``
    and that of poor ones, in and out (EM); wrong matches fill a disc of radius ``spread`` (in units
    of the noise).
    """
    g, step, sums = scratch(3), scratch(3), scratch(4)
    cost = math.inf
    for _ in range(max_iterations):
        variance, wrong = mixture[0], mixture[1]
        clutter = _clutter(variance, wrong, spread)
        cost = rotation_linearize(pairs, prior, R, mixture, clutter, H, g, sums)
        square = sums[3] / greater(2.0 * sums[0] - 3.0, 1.0)
        update_mixture(square, sums, float(count), min_variance, mixture)
        if not solve_three_spd(H, g, 0.0, step):
            break
        apply_rotation_step(R, -step[0], -step[1], -step[2], R)
        size = 0.0
        for k in range(3):
            size += H[k, k] * step[k] * step[k]
        if size < 1e-6 and abs(mixture[0] - variance) < 1e-3 * variance:
            break
    return cost


@formula
def _clutter(variance: float, wrong: float, spread: float) -> float:
    """Density of wrong matches over that of good ones at 0, in two dimensions."""
    return wrong / (1.0 - wrong) * 2.0 * variance / (spread * spread)


@kernel
def explain_rotation(
    pairs: np.ndarray,
    prior: np.ndarray,
    spread: float,
    R: np.ndarray,
    mixture: np.ndarray,
    distance2: np.ndarray,
    right: np.ndarray,
) -> float:
    """Distance of each match as by `rotation_distance2`, and the probability that it is right.

    Returns the share of the information that there is without knowing which matches are good, poor
    or wrong, as `information.information` does.
    """
    rotation_distance2(pairs, R, distance2)
    clutter = _clutter(mixture[0], mixture[1], spread)
    precision = 1.0 / mixture[0]
    known = missing = 0.0
    for i in range(prior.size):
        good, fair, bad = _densities(distance2[i], precision, mixture[2], prior[i])
        over = 1.0 / (good + fair + bad + clutter)
        right[i] = (good + fair + bad) * over
        weight = weight_of(good, fair, bad) * over
        weight2 = weight_of(good, fair * 0.125, bad * 0.015625) * over
        known += weight
        missing += 0.5 * distance2[i] * precision * (weight2 - weight * weight)
    return 1.0 - missing / known if known > 0.0 else 1.0
