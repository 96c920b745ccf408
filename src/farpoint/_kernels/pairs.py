"""The matches as the kernels take them: packed so that one instruction works on several.

Sums over matches are what the time goes into, and a processor adds four or eight numbers at once
where they lie side by side. So matches are packed in panels of `LANES`, in which each coordinate of
all of them stands in a row of its own. The last panel is filled up with matches of prior zero.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inlined_kernel, kernel
from farpoint._kernels.fused import fused
from farpoint._kernels.vectors import Vector

__all__ = [
    "LANES",
    "PANEL",
    "address",
    "flow_variance",
    "noise0",
    "noise1",
    "pack_pairs",
    "packed_length",
    "ray0",
    "ray1",
    "take_pairs",
]

LANES = 16
# Rows of a panel: two rays, their covariances (upper triangles), the mean variance of their flow.
# Of a type of their own: for each plain number numba would compile a function anew.
RAY0, RAY1, COVARIANCE0, COVARIANCE1, FLOW = (np.int64(row) for row in (0, 3, 6, 12, 18))
PANEL = 19 * LANES
# Noise that is smaller is rounding of the rays themselves, rad^2.
MIN_VARIANCE_RAD2 = 1e-30
# That of the matches which fill up a panel: whatever the pose, they agree with it.
VAGUE = 1e12


def packed_length(count: int) -> int:
    """Matches that there is room for in the panels that ``count`` matches need."""
    return -(-count // LANES) * LANES


@inlined_kernel
def address(i: int) -> int:
    """Where the first row has match ``i``; the next row has it `LANES` further on."""
    return i // LANES * PANEL + i % LANES


@inlined_kernel
def _at(pairs: np.ndarray, at: int, row: int) -> Vector:
    # An unsigned index: one that might count from the end keeps the loops from adding several.
    return (
        pairs[np.uint64(at + row * LANES)],
        pairs[np.uint64(at + (row + 1) * LANES)],
        pairs[np.uint64(at + (row + 2) * LANES)],
    )


@inlined_kernel
def ray0(pairs: np.ndarray, at: int) -> Vector:
    """Unit ray in camera 0 of the match at this address."""
    return _at(pairs, at, RAY0)


@inlined_kernel
def ray1(pairs: np.ndarray, at: int) -> Vector:
    """Unit ray in camera 1."""
    return _at(pairs, at, RAY1)


@inlined_kernel
def _covariance_times(pairs: np.ndarray, at: int, row: int, v: Vector) -> Vector:
    x, y = _at(pairs, at, row), _at(pairs, at, row + 3)
    return (
        fused(x[0], v[0], fused(x[1], v[1], x[2] * v[2])),
        fused(x[1], v[0], fused(y[0], v[1], y[1] * v[2])),
        fused(x[2], v[0], fused(y[1], v[1], y[2] * v[2])),
    )


@inlined_kernel
def noise0(pairs: np.ndarray, at: int, v: Vector) -> Vector:
    """Covariance of the ray in camera 0, for unit noise, times ``v``."""
    return _covariance_times(pairs, at, COVARIANCE0, v)


@inlined_kernel
def noise1(pairs: np.ndarray, at: int, v: Vector) -> Vector:
    """Covariance of the ray in camera 1, for unit noise, times ``v``."""
    return _covariance_times(pairs, at, COVARIANCE1, v)


@inlined_kernel
def flow_variance(pairs: np.ndarray, at: int) -> float:
    """Variance, rad^2 for unit noise, of the flow in one direction, on average."""
    return pairs[np.uint64(at + FLOW * LANES)]


@inlined_kernel
def _put_covariance(
    pairs: np.ndarray, at: int, row: int, A: np.ndarray, i: int, C: np.ndarray
) -> float:
    """Store ``A C A^T`` of match ``i`` (C (M, 2, 2), one for all where M = 1); its trace."""
    j = i if C.shape[0] > 1 else 0
    c00, c01, c11 = C[j, 0, 0], C[j, 0, 1], C[j, 1, 1]
    slot = at + row * LANES
    trace = 0.0
    for k in range(3):
        u, v = c00 * A[i, k, 0] + c01 * A[i, k, 1], c01 * A[i, k, 0] + c11 * A[i, k, 1]
        for m in range(k, 3):
            pairs[slot] = u * A[i, m, 0] + v * A[i, m, 1]
            if m == k:
                trace += pairs[slot]
            slot += LANES
    return trace


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
    """Pack the matches whose rays exist; returns how many, and what wrong matches may fill.

    Parameters
    ----------
    rays0, rays1 : (N, 3)
        Unit rays, NaN where there is none.
    factors0, factors1 : (N, 3, 2)
        Derivative of a ray by what the noise is of: pixels, or angles.
    covariance0, covariance1 : (N, 2, 2) or (1, 2, 2)
        Of that noise.
    least_variance : float
        Rays that unit noise moves by less, rad^2, are left out.
    pairs : (packed_length(N) * 19,)
        Receives the panels.
    index : (N,)
        Receives the row of each match that was packed.

    Returns
    -------
    count : int
    spread : float
        Half the width, in units of the noise, of a uniform distribution with the second moment of
        the later rays.
    """
    n = 0
    x = y = z = square = precision = 0.0
    for i in range(rays0.shape[0]):
        squares0 = squares1 = 0.0
        for k in range(3):
            for c in range(2):
                squares0 += factors0[i, k, c] ** 2
                squares1 += factors1[i, k, c] ** 2
        if not (squares0 > least_variance and squares1 > least_variance):  # nor NaN
            continue
        at = address(n)
        for k in range(3):
            pairs[at + (RAY0 + k) * LANES] = rays0[i, k]
            pairs[at + (RAY1 + k) * LANES] = rays1[i, k]
            square += rays1[i, k] ** 2
        x, y, z = x + rays1[i, 0], y + rays1[i, 1], z + rays1[i, 2]
        trace = _put_covariance(pairs, at, COVARIANCE0, factors0, i, covariance0)
        trace += _put_covariance(pairs, at, COVARIANCE1, factors1, i, covariance1)
        variance = max(0.5 * trace, MIN_VARIANCE_RAD2)
        pairs[at + FLOW * LANES] = variance
        precision += 1.0 / variance
        index[n] = i
        n += 1
    _fill_up(pairs, n)
    if n == 0:
        return 0, 10.0
    square -= (x * x + y * y + z * z) / n
    return n, max(math.sqrt(1.5 * max(square, 0.0) / n * precision / n), 10.0)


@inlined_kernel
def _fill_up(pairs: np.ndarray, n: int) -> None:
    """Fill the last panel with matches that are harmless to compute with."""
    for i in range(n, -(-n // LANES) * LANES):
        at = address(i)
        for row in range(19):
            pairs[at + row * LANES] = 0.0
        pairs[at + 2 * LANES] = pairs[at + 5 * LANES] = 1.0
        for row in (0, 3, 5):
            pairs[at + (COVARIANCE0 + row) * LANES] = VAGUE
            pairs[at + (COVARIANCE1 + row) * LANES] = VAGUE
        pairs[at + FLOW * LANES] = VAGUE


@kernel
def take_pairs(pairs: np.ndarray, rows: np.ndarray, taken: np.ndarray) -> None:
    """Copy the matches ``rows`` (M,) into other panels, ``taken``."""
    for j in range(rows.shape[0]):
        source, target = address(rows[j]), address(j)
        for row in range(19):
            taken[target + row * LANES] = pairs[source + row * LANES]
    _fill_up(taken, rows.shape[0])
