"""How much the matches tell of a pose, and how much of that is noise."""

from __future__ import annotations

import numpy as np

from farpoint._kernels.compile import inner_kernel, kernel, sum_kernel
from farpoint._kernels.epipolar import sampson_jacobian, variances
from farpoint._kernels.formulas import choose, formula, lesser
from farpoint._kernels.likelihood import densities, weight_of
from farpoint._kernels.pairs import LANES, PANEL, flow_variance, ray0
from farpoint._kernels.scratch import room
from farpoint._kernels.squares import FIVE, add_square, inverse_square, size2, write_square
from farpoint._kernels.vectors import (
    Matrix,
    Vector,
    combine,
    cross,
    dot,
    matrix,
    rotate,
    tangent_columns,
    vector,
)

__all__ = ["information"]

# A match nearer to the epipole than this, in sigma of its flow, tells nothing of where it is.
EPIPOLE_SIGMA = 8.0
# Leverage beyond which a match is trusted no less.
MOST_LEVERAGE = 0.9
# Rows of a panel of what is told: Jacobian and its change by noise along the line, their weights,
# the weight of the residual and what is missing of it, and the square of the weighted residual.
JACOBIAN, CHANGE, WEIGHT, SHARE, KNOWN, MISSING, SCATTER = (
    np.int64(row) for row in (0, 5, 10, 11, 12, 13, 14)
)
TOLD = 15 * LANES


@kernel
def information(
    pairs: np.ndarray,
    prior: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    mixture: np.ndarray,
    clutter: float,
    whole: np.ndarray,
    noise: np.ndarray,
    scatter: np.ndarray,
) -> float:
    """Gauss-Newton matrix ``whole`` (5, 5) of the cost, and the part of it that is ``noise``.

    The Jacobian of a match grows with its flow, and the flow is measured: noise along the epipolar
    line is taken for flow. With ``u`` the unit vector along the line, noise of variance ``v`` there
    (given the residual) changes the Jacobian by ``[(m . t) u, B^T (m x u)] / sqrt(g)`` times
    itself, and so adds v times that squared. Matches at the epipole are left out: noise alone
    decides on their epipolar line.

    ``scatter`` is the variance of the gradient as the residuals show it, which is ``whole`` where
    their noise is the one that was stated. A match draws the pose towards itself, and so shows a
    smaller square than it had: by ``1 - h`` with h its leverage (MacKinnon and White, J. Econom.
    29, 1985, HC2, DOI 10.1016/0304-4076(85)90158-7).

    Returns the share of this information that there is without knowing which matches are good, poor
    or wrong: what is missing is the variance of the score over these (Louis, J. R. Stat. Soc. B 44,
    1982, DOI 10.1111/j.2517-6161.1982.tb01203.x).
    """
    told = room(prior.size // LANES * TOLD)
    _tell(pairs, prior, R, t, mixture, clutter, told)
    _gram(told, JACOBIAN, WEIGHT, whole)
    _gram(told, CHANGE, SHARE, noise)
    _without_leverage(told, whole)
    _gram(told, JACOBIAN, SCATTER, scatter)
    known, missing = _total(told, KNOWN), _total(told, MISSING)
    return 1.0 - missing / known if known > 0.0 else 1.0


@kernel
def _tell(
    pairs: np.ndarray,
    prior: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    mixture: np.ndarray,
    clutter: float,
    told: np.ndarray,
) -> None:
    """Write down what each match tells."""
    turn, towards = matrix(R), vector(t)
    basis = tangent_columns(towards)
    precision, poor = 1.0 / mixture[0], mixture[2]
    for panel in range(prior.size // LANES):
        for lane in range(LANES):
            at, to = panel * PANEL + lane, panel * TOLD + lane
            share = prior[panel * LANES + lane]
            _tell_of(pairs, at, share, turn, towards, basis, (precision, poor, clutter), told, to)


@formula
def _tell_of(
    pairs: np.ndarray,
    at: int,
    prior: float,
    R: Matrix,
    t: Vector,
    basis: tuple[Vector, Vector],
    noise: tuple[float, float, float],
    told: np.ndarray,
    to: int,
) -> None:
    """Write down what one match tells, in a column of a panel."""
    precision, poor, clutter = noise
    *jacobian, r = sampson_jacobian(pairs, at, R, t, basis)
    m = rotate(R, ray0(pairs, at))
    reach = dot(m, t)
    along = combine(reach, t, -reach * reach, m)
    across = cross(m, t)
    good, fair, bad = densities(pairs, at, R, t, r, precision, poor, prior)
    square = 1.0 - reach * reach
    elsewhere = square > EPIPOLE_SIGMA**2 / precision * flow_variance(pairs, at)
    over = choose(elsewhere, 1.0 / (good + fair + bad + clutter), 0.0)
    w, w2 = weight_of(good, fair, bad) * over, weight_of(good, fair * 0.125, bad * 0.015625) * over
    g, v = variances(pairs, at, R, t)
    change = *along, dot(basis[0], across), dot(basis[1], across)
    weight, share = w * precision, w * v / (g * square * square + 1e-300)
    missing, scatter = r * r * precision * (w2 - w * w), weight * r * weight * r
    rows = *jacobian, *change, weight, share, w, missing, scatter
    for row, value in enumerate(rows):
        told[to + row * LANES] = value


@inner_kernel
def _without_leverage(told: np.ndarray, whole: np.ndarray) -> None:
    """Make up for what of its residual each match has taken by drawing the pose."""
    inverse, positive = inverse_square(whole)
    if not positive:
        return
    for panel in range(told.size // TOLD):
        for lane in range(LANES):
            at = panel * TOLD + lane
            drawn = told[at + WEIGHT * LANES] * size2(inverse, _five(told, at))
            told[at + SCATTER * LANES] /= 1.0 - lesser(drawn, MOST_LEVERAGE)


@sum_kernel
def _gram(told: np.ndarray, row: int, weight: int, out: np.ndarray) -> None:
    """``A diag(w) A^T`` (5, 5) of five rows A and the row w of what is told."""
    sums = FIVE
    for panel in range(told.size // TOLD):
        for lane in range(LANES):
            at = panel * TOLD + lane
            sums = add_square(sums, told[at + weight * LANES], _five(told, at + row * LANES))
    write_square(sums, out)


@formula
def _five(told: np.ndarray, at: int) -> tuple[float, float, float, float, float]:
    a, b, c, d, e = (told[at + row * LANES] for row in range(5))
    return a, b, c, d, e


@inner_kernel
def _total(told: np.ndarray, row: int) -> float:
    total = 0.0
    for panel in range(told.size // TOLD):
        for lane in range(LANES):
            total += told[panel * TOLD + row * LANES + lane]
    return total
