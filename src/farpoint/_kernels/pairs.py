"""Matches packed in panels for vector instructions.

Most of the time is spent on sums over matches, and a processor adds four or eight numbers at once
if the numbers are neighbours in memory. A panel holds `LANES` matches. Each row of a panel holds
one coordinate of all these matches. The last panel is filled up with matches of prior 0 (filler).

The panels hold the covariances of the rays for a noise sigma of 1. The actual covariances are
sigma^2 times as large; sigma is estimated. The unit of sigma is px, or ``noise_rad`` if the user
gave rays.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inlined_kernel, inner_kernel, kernel, step_kernel
from farpoint._kernels.constants import (
    COVARIANCE0,
    COVARIANCE1,
    FLOW,
    LANES,
    MIN_VARIANCE_RAD2,
    NO_INFORMATION_VARIANCE,
    PANEL,
    RAY0,
    RAY1,
)
from farpoint._kernels.scalars import fma
from farpoint._kernels.vectors import Vector, axpby, dot

__all__ = [
    "address",
    "flow_variance",
    "is_finite",
    "noise0",
    "noise1",
    "pack_pairs",
    "packed_length",
    "ray0",
    "ray1",
    "take_pairs",
]


def packed_length(count: int) -> int:
    """Number of matches, filler included, in the panels for ``count`` matches."""
    return -(-count // LANES) * LANES


@inlined_kernel
def address(i: int) -> int:
    """Address of match ``i``: index of the match's element in the first row of the panel.

    The element of the match in the next row is `LANES` further on.
    """
    return (i >> 4) * PANEL + (i & 15)


@inlined_kernel
def _three(pairs: np.ndarray, at: int) -> Vector:
    """Three numbers of a match, from the row at the address ``at`` and the next two rows."""
    return pairs[at], pairs[at + LANES], pairs[at + 2 * LANES]


@inlined_kernel
def ray0(pairs: np.ndarray, at: int) -> Vector:
    """Unit ray in camera 0 of the match at the address ``at``."""
    return _three(pairs, at)


@inlined_kernel
def ray1(pairs: np.ndarray, at: int) -> Vector:
    """Unit ray in camera 1 of the match at the address ``at``."""
    return _three(pairs, at + RAY1 * LANES)


@inlined_kernel
def _covariance_times(pairs: np.ndarray, at: int, v: Vector) -> Vector:
    x, y = _three(pairs, at), _three(pairs, at + 3 * LANES)
    return (
        fma(x[0], v[0], fma(x[1], v[1], x[2] * v[2])),
        fma(x[1], v[0], fma(y[0], v[1], y[1] * v[2])),
        fma(x[2], v[0], fma(y[1], v[1], y[2] * v[2])),
    )


@inlined_kernel
def noise0(pairs: np.ndarray, at: int, v: Vector) -> Vector:
    """Covariance of the ray in camera 0, for a noise sigma of 1, times ``v``."""
    return _covariance_times(pairs, at + COVARIANCE0 * LANES, v)


@inlined_kernel
def noise1(pairs: np.ndarray, at: int, v: Vector) -> Vector:
    """Covariance of the ray in camera 1, for a noise sigma of 1, times ``v``."""
    return _covariance_times(pairs, at + COVARIANCE1 * LANES, v)


@inlined_kernel
def flow_variance(pairs: np.ndarray, at: int) -> float:
    """Mean variance of the flow per coordinate, rad^2, for a noise sigma of 1."""
    return pairs[at + FLOW * LANES]


@inlined_kernel
def _put_ray(pairs: np.ndarray, slot: int, rays: np.ndarray, i: int) -> Vector:
    """Store ray ``i``, and return it."""
    for k in range(3):
        pairs[slot + k * LANES] = rays[i, k]
    return rays[i, 0], rays[i, 1], rays[i, 2]


@inlined_kernel
def _put_covariance(
    pairs: np.ndarray, slot: int, A: np.ndarray, i: int, C: np.ndarray, j: int
) -> float:
    """Store ``A C A^T`` of a match: derivative ``A[i]`` (3, 2), noise covariance ``C[j]`` (2, 2).

    The function returns the trace of ``A C A^T``.
    """
    c00, c01, c11 = C[j, 0, 0], C[j, 0, 1], C[j, 1, 1]
    trace = 0.0
    for k in range(3):
        u, v = c00 * A[i, k, 0] + c01 * A[i, k, 1], c01 * A[i, k, 0] + c11 * A[i, k, 1]
        for m in range(k, 3):
            element = u * A[i, m, 0] + v * A[i, m, 1]
            pairs[slot] = element
            trace = element + trace if m == k else trace
            slot = slot + LANES
    return trace


@inlined_kernel
def _squares(factors: np.ndarray, i: int) -> float:
    """Sum of the squared elements of the derivative (3, 2) of ray ``i``."""
    square = 0.0
    for k in range(3):
        for c in range(2):
            square = square + factors[i, k, c] * factors[i, k, c]
    return square


@kernel
def is_finite(values: np.ndarray) -> bool:
    """Whether all numbers (N,) are finite. For few numbers this is 10 times as fast as NumPy."""
    infinite = 0
    for i in range(values.size):
        infinite += 0 if abs(values[i]) < math.inf else 1
    return infinite == 0


@kernel
def pack_pairs(
    rays0: np.ndarray,
    rays1: np.ndarray,
    factors0: np.ndarray,
    factors1: np.ndarray,
    covariance0: np.ndarray,
    covariance1: np.ndarray,
    least_variance: float,
    pairs: np.ndarray,
    index: np.ndarray,
) -> tuple[int, float]:
    """Pack the matches whose rays exist.

    Parameters
    ----------
    rays0, rays1 : (N, 3)
        Unit rays; NaN for a pixel without a ray.
    factors0, factors1 : (N, 3, 2)
        Derivatives of the rays by the noisy quantity: the pixel, or an angle in units of
        ``noise_rad``.
    covariance0, covariance1 : (N, 2, 2) or (1, 2, 2)
        Covariances of the noisy quantity.
    least_variance : float
        A match is left out if, for one of its rays, the sum of the squared elements of the
        derivative is not larger than this value.
    pairs : (packed_length(N) * 19,)
        Receives the panels.
    index : (N,)
        Receives the row of each match that was packed.

    Returns
    -------
    count : int
        Number of matches packed.
    outlier_half_width : float
        Half-width, in the unit of the noise sigma, of a uniform distribution with the variance of a
        coordinate of the rays in camera 1; at least 10.
    """
    n = np.int64(0)
    square = precision = 0.0
    mean = 0.0, 0.0, 0.0
    for i in range(len(rays0)):
        if not _squares(factors0, i) > least_variance:  # or NaN
            continue
        if not _squares(factors1, i) > least_variance:
            continue
        at = address(n)
        _put_ray(pairs, at, rays0, i)
        ray = _put_ray(pairs, at + RAY1 * LANES, rays1, i)
        square += dot(ray, ray)
        mean = axpby(1.0, mean, 1.0, ray)
        j, k = i if len(covariance0) > 1 else 0, i if len(covariance1) > 1 else 0
        trace = _put_covariance(pairs, at + COVARIANCE0 * LANES, factors0, i, covariance0, j)
        trace += _put_covariance(pairs, at + COVARIANCE1 * LANES, factors1, i, covariance1, k)
        variance = max(0.5 * trace, MIN_VARIANCE_RAD2)
        pairs[at + FLOW * LANES] = variance
        precision += 1.0 / variance
        index[n] = i
        n += 1
    _fill_up(pairs, n)
    if n == 0:
        return 0, 10.0
    square -= dot(mean, mean) / n
    return int(n), max(math.sqrt(1.5 * max(square, 0.0) / n * precision / n), 10.0)


@inner_kernel
def _fill_up(pairs: np.ndarray, n: int) -> None:
    """Fill the last panel with matches that are consistent with any pose."""
    for i in range(n, -(-n // LANES) * LANES):
        _put_filler(pairs, address(i))


@step_kernel
def _put_filler(pairs: np.ndarray, at: int) -> None:
    for row in range(FLOW):
        pairs[at + row * LANES] = 0.0
    for row in (RAY0 + 2, RAY1 + 2):
        pairs[at + row * LANES] = 1.0
    for row in (COVARIANCE0, COVARIANCE1):
        for diagonal in (0, 3, 5):
            pairs[at + (row + diagonal) * LANES] = NO_INFORMATION_VARIANCE
    pairs[at + FLOW * LANES] = NO_INFORMATION_VARIANCE


@kernel
def take_pairs(pairs: np.ndarray, rows: np.ndarray, taken: np.ndarray) -> None:
    """Copy the matches ``rows`` (M,) into other panels, ``taken``."""
    for j in range(rows.size):
        source, target = address(rows[j]), address(j)
        for row in range(19):
            taken[target + row * LANES] = pairs[source + row * LANES]
    _fill_up(taken, rows.size)
