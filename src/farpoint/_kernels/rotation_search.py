"""Rotation of the far matches by RANSAC with samples of three rays, and the consistent matches."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.arrays import clear, copy
from farpoint._kernels.compile import inlined_kernel, kernel, sum_kernel
from farpoint._kernels.constants import LANES, PANEL
from farpoint._kernels.linear import add_outer, draw_index, kabsch
from farpoint._kernels.pairs import address, flow_variance, ray0, ray1
from farpoint._kernels.vectors import Matrix, Vector, axpby, dot, matrix, rotate

__all__ = ["enlarge_rotation", "search_rotation"]


@inlined_kernel
def _distance2(pairs: np.ndarray, at: int, R: Matrix) -> float:
    """``|b - R a|^2`` divided by the mean variance of a coordinate for a noise sigma of 1."""
    d = axpby(1.0, ray1(pairs, at), -1.0, rotate(R, ray0(pairs, at)))
    return dot(d, d) / flow_variance(pairs, at)


@sum_kernel
def _truncated_squares(pairs: np.ndarray, R: np.ndarray, limit: float, best: float) -> float:
    """Sum of the squared distances from a rotation, each limited to ``limit``.

    If the sum exceeds ``best``, the function returns early with a value of at least ``best``.
    """
    rotation = matrix(R)
    cost = 0.0
    for panel in range(pairs.size // PANEL):
        for lane in range(LANES):
            cost += min(_distance2(pairs, panel * PANEL + lane, rotation), limit)
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
    """Search for a rotation by RANSAC on samples of three rays (Burschka, Mair 2008, eqs. 7-13).

    The search minimises the truncated squares ``sum min(|b - R a|^2 / variance, tolerance^2)`` of
    the ``count`` matches. The search ends when, with 99.9 % probability, a sample of consistent
    rays has been drawn. ``R`` receives the best rotation. The function returns the number of
    iterations.
    """
    limit = tolerance * tolerance
    hypothesis, M = np.empty((3, 3)), np.empty((3, 3))
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
                needed = min(max_iterations, int(math.log(1e-3) / math.log(miss)) + 1)
            elif miss <= 1e-3:
                break
    return iteration


@sum_kernel
def _correlate(pairs: np.ndarray, R: np.ndarray, limit: float, M: np.ndarray) -> float:
    """``M = sum b a^T / variance`` over the matches within ``limit`` of a rotation.

    The function returns the number of these matches. Filler is within any limit and has weight 0.
    """
    rotation = matrix(R)
    inside = 0.0
    sums = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for panel in range(pairs.size // PANEL):
        for lane in range(LANES):
            at = panel * PANEL + lane
            agrees = 1.0 if _distance2(pairs, at, rotation) <= limit else 0.0
            inside += agrees
            weight = agrees / flow_variance(pairs, at)
            sums = _add_product(sums, weight, ray1(pairs, at), ray0(pairs, at))
    _write_rows(sums, M)
    return inside


@sum_kernel
def _add_product(sums: Matrix, weight: float, b: Vector, a: Vector) -> Matrix:
    """``sums + weight b a^T``, by rows."""
    by_x, by_y, by_z = sums
    x, y, z = weight * b[0], weight * b[1], weight * b[2]
    return _plus(by_x, x, a), _plus(by_y, y, a), _plus(by_z, z, a)


@sum_kernel
def _plus(sums: Vector, s: float, a: Vector) -> Vector:
    """``sums + s a``."""
    return sums[0] + s * a[0], sums[1] + s * a[1], sums[2] + s * a[2]


@inlined_kernel
def _write_rows(elements: Matrix, M: np.ndarray) -> None:
    """Write a matrix (3, 3)."""
    x, y, z = elements
    M[0, 0], M[0, 1], M[0, 2] = x
    M[1, 0], M[1, 1], M[1, 2] = y
    M[2, 0], M[2, 1], M[2, 2] = z


@kernel
def enlarge_rotation(
    pairs: np.ndarray, count: int, tolerance: float, R: np.ndarray, consistent: np.ndarray
) -> int:
    """Enlarge the set of consistent matches step by step, and fit the rotation after each step.

    The limit increases from 0.5 to 1 times the tolerance, because the error of a rotation from
    three noisy rays is about as large as the noise of a far point. ``consistent`` (count,) receives
    whether each match is within the tolerance. ``R`` is improved in place. The function returns the
    number of consistent matches of the last fit.
    """
    M = np.empty((3, 3))
    filled_up = pairs.size // PANEL * LANES - count
    limit = tolerance * tolerance
    size = 0
    for step in range(12):
        previous = size
        part = min(1.0, 0.5 + 0.125 * step)
        within = limit * part * part
        size = int(_correlate(pairs, R, within, M)) - filled_up
        if step > 4 and size == previous:
            break
        if size < 2 or not kabsch(M, R):
            break
    rotation = matrix(R)
    for i in range(count):
        consistent[i] = _distance2(pairs, address(i), rotation) <= limit
    return size
