"""Least squares in registers: sums of ``weight row row^T``, and what they are equal to.

A sum is kept as a tuple, the lower triangle by rows: an array would make each term wait for the one
before to be stored.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from farpoint._kernels.formulas import formula, sum_formula

__all__ = [
    "FIVE",
    "FOUR",
    "SIX",
    "add_square",
    "add_to_square",
    "determinant_beside_one",
    "inverse_square",
    "promise",
    "sandwich_five",
    "size2",
    "solve_five_spd",
    "solve_three_spd",
    "write_square",
]

Sums = tuple[float, ...]
# The sum of nothing, for rows of so many numbers.
FOUR: Sums = (0.0,) * 10
FIVE: Sums = (0.0,) * 15
SIX: Sums = (0.0,) * 21


@sum_formula
def add_square(sums: Sums, weight: float, row: Sums) -> Sums:
    """``sums + weight row row^T``."""
    scaled = [weight * x for x in row]
    terms = [scaled[j] * row[i] for i in range(len(row)) for j in range(i + 1)]
    return tuple(so_far + term for so_far, term in zip(sums, terms, strict=True))


@formula
def write_square(sums: Sums, out: np.ndarray) -> None:
    """Write both triangles of a sum into ``out`` (n, n)."""
    rest = iter(sums)
    for i in range(math.isqrt(2 * len(sums))):
        for j in range(i + 1):
            out[i, j] = out[j, i] = next(rest)


@formula
def add_to_square(weight: float, row: Sums, out: np.ndarray) -> None:
    """Add ``weight row row^T`` to ``out`` (n, n)."""
    for i in range(len(row)):
        for j in range(i + 1):
            out[i, j] = out[j, i] = out[i, j] + weight * row[i] * row[j]


@formula
def solve_five_spd(normal: np.ndarray, damping: float, x: np.ndarray) -> bool:
    """Solve normal equations (6, 6), the right side in their last column, for the five of a pose.

    As `solve_three_spd`.
    """
    factors = _Factors(lambda i, j: normal[i, j], 5, damping)
    for i, element in enumerate(factors.solve([normal[i, 5] for i in range(5)])):
        x[i] = element
    return factors.positive


@formula
def solve_three_spd(H: np.ndarray, g: np.ndarray, damping: float, x: np.ndarray) -> bool:
    """Solve ``(H + damping * diag(H)) x = g``, all (3, 3) and (3,).

    False, and ``x`` without a meaning, where that is not positive definite.
    """
    factors = _Factors(lambda i, j: H[i, j], 3, damping)
    for i, element in enumerate(factors.solve([g[i] for i in range(3)])):
        x[i] = element
    return factors.positive


@formula
def sandwich_five(
    whole: np.ndarray, part: np.ndarray, inner: np.ndarray, least: float, out: np.ndarray
) -> bool:
    """As `linear.sandwich`; ``out`` has no meaning where it is False."""
    bound = _Factors(lambda i, j: (1.0 - least) * whole[i, j] - part[i, j], 5)
    H = _Factors(lambda i, j: whole[i, j] - part[i, j], 5)
    rows = [H.solve([inner[i, j] for j in range(5)]) for i in range(5)]  # of V H^-1
    columns = [H.solve([row[j] for row in rows]) for j in range(5)]
    for i in range(5):
        for j in range(i + 1):
            out[i, j] = out[j, i] = 0.5 * (columns[j][i] + columns[i][j])
    return bound.positive


@formula
def inverse_square(H: np.ndarray) -> tuple[Sums, bool]:
    """What `size2` needs of a matrix (5, 5), and whether that is positive definite."""
    factors = _Factors(lambda i, j: H[i, j], 5)
    lower = [factors.lower[i][j] for i in range(5) for j in range(i)]
    return (*lower, *factors.over), factors.positive


@formula
def size2(inverse: Sums, row: Sums) -> float:
    """``row^T H^-1 row`` with what `inverse_square` says of H."""
    lower = [[inverse[i * (i - 1) // 2 + j] for j in range(i)] for i in range(5)]
    y = _forward(lower, row)
    total = 0.0
    for k in range(5):
        total = total + y[k] * y[k] * inverse[10 + k]
    return total


@formula
def determinant_beside_one(H: np.ndarray) -> tuple[float, bool]:
    """Determinant of ``H + 1``, of five rows and columns, and whether that is positive definite."""
    factors = _Factors(lambda i, j: H[i, j] + (1.0 if i == j else 0.0), 5)
    determinant = 1.0
    for over in factors.over:
        determinant = determinant / over
    return determinant, factors.positive


def _forward(lower: Sequence[Sequence[float]], right: Sequence[float]) -> list[float]:
    """``y`` with ``L y`` the right side."""
    y: list[float] = []
    for i, left in enumerate(right):
        for k in range(i):
            left = left - lower[i][k] * y[k]
        y.append(left)
    return y


class _Factors:
    """A symmetric matrix (n, n), its diagonal ``1 + damping`` times as large, as ``L D L^T``.

    Each element is in a register of its own: three times as fast as loops over indices, which wait
    for memory and for one root after another.
    """

    def __init__(self, element: Callable[[int, int], float], n: int, damping: float = 0.0) -> None:
        self.lower = [[0.0] * n for _ in range(n)]
        self.over: list[float] = []  # inverse of D
        scaled = [[0.0] * n for _ in range(n)]  # L D
        self.positive = element(0, 0) < math.inf
        for j in range(n):
            for i in range(j, n):
                left = element(i, j) if i > j else (1.0 + damping) * element(j, j)
                for k in range(j):
                    left = left - self.lower[i][k] * scaled[j][k]
                scaled[i][j] = left
            pivot = scaled[j][j]
            self.positive = self.positive & (pivot > 1e-14 * element(j, j)) & (pivot < math.inf)
            self.over.append(1.0 / pivot)
            for i in range(j + 1, n):
                self.lower[i][j] = scaled[i][j] * self.over[j]

    def solve(self, right: Sequence[float]) -> list[float]:
        """``x`` with the matrix times ``x`` the right side."""
        x = _forward(self.lower, right)
        for i in reversed(range(len(x))):
            x[i] = x[i] * self.over[i]
            for k in range(i + 1, len(x)):
                x[i] = x[i] - self.lower[k][i] * x[k]
        return x


@formula
def promise(normal: np.ndarray, x: np.ndarray) -> tuple[float, float]:
    """What a step that solves normal equations gains, and its square."""
    gain = square = 0.0
    for k in range(5):
        gain = gain + normal[k, 5] * x[k]
        square = square + x[k] * x[k]
    return gain, square
