"""Normal equations in registers: sums of ``weight row row^T``, and their solution.

A sum is a tuple with the lower triangle by rows, and no array: in an array each addition would wait
until the previous addition is stored. For the same reason, the factorisation of a matrix is written
out without loops over indices, and is 3 times as fast.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inlined_kernel, inner_kernel, step_kernel, sum_kernel

__all__ = [
    "add_five",
    "add_four",
    "add_row",
    "add_six",
    "add_to_square",
    "determinant_beside_one",
    "inverse_square",
    "predicted_decrease",
    "sandwich_five",
    "size2",
    "solve_five_spd",
    "solve_three_spd",
    "write_five",
    "write_six",
]

Sums = tuple[float, ...]


@sum_kernel
def add_four(sums: Sums, weight: float, row: Sums) -> Sums:
    """``sums + weight row row^T`` for rows of 4 numbers."""
    aa, ba, bb, ca, cb, cc, da, db, dc, dd = sums
    a, b, c, d = row
    u, v, w, x = weight * a, weight * b, weight * c, weight * d
    return (
        aa + u * a,
        ba + u * b,
        bb + v * b,
        ca + u * c,
        cb + v * c,
        cc + w * c,
        da + u * d,
        db + v * d,
        dc + w * d,
        dd + x * d,
    )


@sum_kernel
def add_five(sums: Sums, weight: float, row: Sums) -> Sums:
    """``sums + weight row row^T`` for rows of 5 numbers."""
    ea, eb, ec, ed, ee = sums[10:]
    a, b, c, d, e = row
    by_e = weight * e
    last = ea + by_e * a, eb + by_e * b, ec + by_e * c, ed + by_e * d, ee + by_e * e
    return add_four(sums[:10], weight, (a, b, c, d)) + last


@sum_kernel
def add_six(sums: Sums, weight: float, row: Sums) -> Sums:
    """``sums + weight row row^T`` for rows of 6 numbers."""
    fa, fb, fc, fd, fe, ff = sums[15:]
    a, b, c, d, e, f = row
    by_f = weight * f
    last = fa + by_f * a, fb + by_f * b, fc + by_f * c, fd + by_f * d, fe + by_f * e, ff + by_f * f
    return add_five(sums[:15], weight, (a, b, c, d, e)) + last


@inner_kernel
def write_five(sums: Sums, out: np.ndarray) -> None:
    """Write both triangles of a sum to the first five rows and columns of ``out``."""
    aa, ba, bb, ca, cb, cc, da, db, dc, dd, ea, eb, ec, ed, ee = sums
    out[0, 0], out[0, 1], out[0, 2], out[0, 3], out[0, 4] = aa, ba, ca, da, ea
    out[1, 0], out[1, 1], out[1, 2], out[1, 3], out[1, 4] = ba, bb, cb, db, eb
    out[2, 0], out[2, 1], out[2, 2], out[2, 3], out[2, 4] = ca, cb, cc, dc, ec
    out[3, 0], out[3, 1], out[3, 2], out[3, 3], out[3, 4] = da, db, dc, dd, ed
    out[4, 0], out[4, 1], out[4, 2], out[4, 3], out[4, 4] = ea, eb, ec, ed, ee


@inner_kernel
def write_six(sums: Sums, out: np.ndarray) -> None:
    """Write both triangles of a sum into ``out`` (6, 6)."""
    write_five(sums[:15], out)
    a, b, c, d, e, out[5, 5] = sums[15:]
    out[5, 0], out[5, 1], out[5, 2], out[5, 3], out[5, 4] = a, b, c, d, e
    out[0, 5], out[1, 5], out[2, 5], out[3, 5], out[4, 5] = a, b, c, d, e


@step_kernel
def add_to_square(weight: float, row: Sums, out: np.ndarray) -> None:
    """Add ``weight row row^T`` to ``out`` (n, n)."""
    for i in range(len(row)):
        for j in range(i + 1):
            out[i, j] = out[j, i] = out[i, j] + weight * row[i] * row[j]


@inner_kernel
def add_row(row: np.ndarray, weight: float, residual: float, H: np.ndarray, g: np.ndarray) -> None:
    """``H += weight row row^T``, lower triangle, and ``g += weight residual row``."""
    for j in range(len(g)):
        scaled = weight * row[j]
        g[j] += scaled * residual
        for m in range(j + 1):
            H[j, m] += scaled * row[m]


@inlined_kernel
def _triangle_of(A: np.ndarray) -> Sums:
    """Lower triangle of the first five rows of a symmetric array."""
    a, ba, b, ca, cb, c = A[0, 0], A[1, 0], A[1, 1], A[2, 0], A[2, 1], A[2, 2]
    da, db, dc, d = A[3, 0], A[3, 1], A[3, 2], A[3, 3]
    return a, ba, b, ca, cb, c, da, db, dc, d, A[4, 0], A[4, 1], A[4, 2], A[4, 3], A[4, 4]


@inner_kernel
def _factor(triangle: Sums, damping: float) -> tuple[Sums, bool]:
    """Factors ``L D L^T`` of a symmetric matrix (5, 5).

    The diagonal of the matrix is first multiplied by ``1 + damping``. The function returns the rows
    of L below the diagonal, the inverse of D, and whether the matrix is positive definite.
    """
    a, ba, b, ca, cb, c, da, db, dc, d, ea, eb, ec, ed, e = triangle
    more = 1.0 + damping
    p = more * a
    over_p = 1.0 / p
    bp, cp, dp, ep = ba * over_p, ca * over_p, da * over_p, ea * over_p
    q = more * b - bp * ba
    over_q = 1.0 / q
    qc, qd, qe = cb - cp * ba, db - dp * ba, eb - ep * ba
    cq, dq, eq = qc * over_q, qd * over_q, qe * over_q
    r = more * c - cp * ca - cq * qc
    over_r = 1.0 / r
    rd, re = dc - dp * ca - dq * qc, ec - ep * ca - eq * qc
    dr, er = rd * over_r, re * over_r
    s = more * d - dp * da - dq * qd - dr * rd
    over_s = 1.0 / s
    se = ed - ep * da - eq * qd - er * rd
    es = se * over_s
    t = more * e - ep * ea - eq * qe - er * re - es * se
    positive = (
        _is_positive(p, a)
        & _is_positive(q, b)
        & _is_positive(r, c)
        & _is_positive(s, d)
        & _is_positive(t, e)
    )
    inverses = over_p, over_q, over_r, over_s, 1.0 / t
    return (bp, cp, cq, dp, dq, dr, ep, eq, er, es) + inverses, positive  # noqa: RUF005


@inlined_kernel
def _is_positive(pivot: float, diagonal: float) -> bool:
    """Whether a pivot of D is finite and exceeds the rounding error of the diagonal element."""
    return (pivot > 1e-14 * diagonal) & (pivot < math.inf)


@inlined_kernel
def _forward(factors: Sums, right: Sums) -> Sums:
    """Solve ``L y = right`` for y."""
    bp, cp, cq, dp, dq, dr, ep, eq, er, es = factors[:10]
    a, b, c, d, e = right
    b = b - bp * a
    c = c - cp * a - cq * b
    d = d - dp * a - dq * b - dr * c
    return a, b, c, d, e - ep * a - eq * b - er * c - es * d


@inner_kernel
def _solve(factors: Sums, right: Sums) -> Sums:
    """Solve ``L D L^T x = right`` for x."""
    bp, cp, cq, dp, dq, dr, ep, eq, er, es, over_a, over_b, over_c, over_d, over_e = factors
    a, b, c, d, e = _forward(factors, right)
    e = e * over_e
    d = d * over_d - es * e
    c = c * over_c - dr * d - er * e
    b = b * over_b - cq * c - dq * d - eq * e
    return a * over_a - bp * b - cp * c - dp * d - ep * e, b, c, d, e


@inner_kernel
def solve_five_spd(normal: np.ndarray, damping: float, x: np.ndarray) -> bool:
    """Solve normal equations for the five unknowns of a pose.

    The last column of ``normal`` (6, 6) is the right side. Damping and result are those of
    `solve_three_spd`.
    """
    factors, positive = _factor(_triangle_of(normal), damping)
    right = normal[0, 5], normal[1, 5], normal[2, 5], normal[3, 5], normal[4, 5]
    x[0], x[1], x[2], x[3], x[4] = _solve(factors, right)
    return positive


@inner_kernel
def solve_three_spd(H: np.ndarray, g: np.ndarray, damping: float, x: np.ndarray) -> bool:
    """Solve ``(H + damping * diag(H)) x = g`` for H (3, 3) and g (3,).

    If the matrix is not positive definite, the function returns False and ``x`` is undefined.
    """
    more = 1.0 + damping
    p = more * H[0, 0]
    over_p = 1.0 / p
    bp, cp = H[1, 0] * over_p, H[2, 0] * over_p
    q = more * H[1, 1] - bp * H[1, 0]
    over_q = 1.0 / q
    qc = H[2, 1] - cp * H[1, 0]
    cq = qc * over_q
    r = more * H[2, 2] - cp * H[2, 0] - cq * qc
    a, b = g[0], g[1] - bp * g[0]
    c = (g[2] - cp * a - cq * b) * (1.0 / r)
    b = b * over_q - cq * c
    x[0], x[1], x[2] = a * over_p - bp * b - cp * c, b, c
    return _is_positive(p, H[0, 0]) & _is_positive(q, H[1, 1]) & _is_positive(r, H[2, 2])


@step_kernel
def sandwich_five(
    whole: np.ndarray, part: np.ndarray, inner: np.ndarray, least: float, out: np.ndarray
) -> bool:
    """`linear.sandwich`, computed in registers; ``out`` is undefined if the result is False."""
    H, half = np.empty((5, 5)), np.empty((5, 5))
    for i in range(5):
        for j in range(5):
            H[i, j] = (1.0 - least) * whole[i, j] - part[i, j]
    _, positive = _factor(_triangle_of(H), 0.0)
    for i in range(5):
        for j in range(5):
            H[i, j] = whole[i, j] - part[i, j]
    factors, _ = _factor(_triangle_of(H), 0.0)
    for i in range(len(out)):  # rows of V H^-1
        row = inner[i, 0], inner[i, 1], inner[i, 2], inner[i, 3], inner[i, 4]
        half[i, 0], half[i, 1], half[i, 2], half[i, 3], half[i, 4] = _solve(factors, row)
    for j in range(len(out)):
        column = half[0, j], half[1, j], half[2, j], half[3, j], half[4, j]
        H[0, j], H[1, j], H[2, j], H[3, j], H[4, j] = _solve(factors, column)
    for i in range(5):
        for j in range(5):
            out[i, j] = 0.5 * (H[i, j] + H[j, i])
    return positive


@inner_kernel
def inverse_square(H: np.ndarray) -> tuple[Sums, bool]:
    """Factor of a matrix (5, 5) for `size2`, and whether the matrix is positive definite."""
    return _factor(_triangle_of(H), 0.0)


@inlined_kernel
def size2(inverse: Sums, row: Sums) -> float:
    """``row^T H^-1 row``, from the factor that `inverse_square` returns."""
    a, b, c, d, e = _forward(inverse, row)
    over_a, over_b, over_c, over_d, over_e = inverse[10:]
    return a * a * over_a + b * b * over_b + c * c * over_c + d * d * over_d + e * e * over_e


@step_kernel
def determinant_beside_one(H: np.ndarray) -> tuple[float, bool]:
    """Determinant of ``H + I`` (5, 5), and whether ``H + I`` is positive definite."""
    a, ba, b, ca, cb, c, da, db, dc, d, ea, eb, ec, ed, e = _triangle_of(H)
    a, b, c, d, e = a + 1.0, b + 1.0, c + 1.0, d + 1.0, e + 1.0
    triangle = a, ba, b, ca, cb, c, da, db, dc, d, ea, eb, ec, ed, e
    factors, positive = _factor(triangle, 0.0)
    over_a, over_b, over_c, over_d, over_e = factors[10:]
    return 1.0 / over_a / over_b / over_c / over_d / over_e, positive


@inlined_kernel
def predicted_decrease(normal: np.ndarray, x: np.ndarray) -> tuple[float, float]:
    """``g . x`` for a Gauss-Newton step ``x`` and the gradient g, and ``|x|^2``.

    To second order, a step ``-x`` without damping decreases the cost by half of ``g . x``. The
    tolerances for a predicted decrease are compared with ``g . x``.
    """
    gain = square = 0.0
    for k in range(5):
        gain += normal[k, 5] * x[k]
        square += x[k] * x[k]
    return gain, square
