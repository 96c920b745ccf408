"""How much the matches tell of a pose, and how much of that is noise."""

from __future__ import annotations

import numpy as np

from farpoint._kernels.compile import inlined_kernel, kernel, sum_kernel
from farpoint._kernels.epipolar import sampson_jacobian, variances
from farpoint._kernels.likelihood import densities
from farpoint._kernels.linear import cholesky
from farpoint._kernels.pairs import LANES, PANEL, flow_variance, ray0
from farpoint._kernels.vectors import combine, cross, dot, matrix, rotate, tangent_columns, vector

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
    told = np.empty(prior.shape[0] // LANES * TOLD)
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
    for panel in range(prior.shape[0] // LANES):
        for lane in range(LANES):
            at, to = panel * PANEL + lane, panel * TOLD + lane
            r, j0, j1, j2, j3, j4 = sampson_jacobian(pairs, at, turn, towards, basis)
            _put_five(told, to, j0, j1, j2, j3, j4)
            m = rotate(turn, ray0(pairs, at))
            reach = dot(m, towards)
            along = combine(reach, towards, -reach * reach, m)
            across = cross(m, towards)
            change = dot(basis[0], across), dot(basis[1], across)
            _put_five(told, to + CHANGE * LANES, along[0], along[1], along[2], *change)
            p = prior[panel * LANES + lane]
            good, fair = densities(pairs, at, turn, towards, r, precision, poor, p)
            square = 1.0 - reach * reach
            elsewhere = square > EPIPOLE_SIGMA**2 * mixture[0] * flow_variance(pairs, at)
            over = 1.0 / (good + fair + clutter) if elsewhere else 0.0
            w, w2 = (good + fair * 0.125) * over, (good + fair * 0.125 * 0.125) * over
            g, v = variances(pairs, at, turn, towards)
            told[to + WEIGHT * LANES] = w * precision
            told[to + SHARE * LANES] = w * v / (g * square * square + 1e-300)
            told[to + KNOWN * LANES] = w
            told[to + MISSING * LANES] = r * r * precision * (w2 - w * w)
            told[to + SCATTER * LANES] = (w * precision * r) ** 2


@kernel
def _without_leverage(told: np.ndarray, whole: np.ndarray) -> None:
    """Make up for what of its residual each match has taken by drawing the pose."""
    L = np.empty((5, 5))
    if not cholesky(whole, 0.0, L):
        return
    for at in range(5):
        L[at, at] = 1.0 / L[at, at]
    for panel in range(told.shape[0] // TOLD):
        for lane in range(LANES):
            at = panel * TOLD + lane
            a = L[0, 0] * told[at]
            b = L[1, 1] * (told[at + LANES] - L[1, 0] * a)
            c = L[2, 2] * (told[at + 2 * LANES] - L[2, 0] * a - L[2, 1] * b)
            d = L[3, 3] * (told[at + 3 * LANES] - L[3, 0] * a - L[3, 1] * b - L[3, 2] * c)
            e = told[at + 4 * LANES] - L[4, 0] * a - L[4, 1] * b - L[4, 2] * c - L[4, 3] * d
            square = a * a + b * b + c * c + d * d + (L[4, 4] * e) ** 2
            rest = 1.0 - min(told[at + WEIGHT * LANES] * square, MOST_LEVERAGE)
            told[at + SCATTER * LANES] /= rest


@inlined_kernel
def _put_five(told: np.ndarray, to: int, a: float, b: float, c: float, d: float, e: float) -> None:
    told[to], told[to + LANES], told[to + 2 * LANES] = a, b, c
    told[to + 3 * LANES], told[to + 4 * LANES] = d, e


@sum_kernel
def _gram(told: np.ndarray, row: int, weight: int, out: np.ndarray) -> None:
    """``A diag(w) A^T`` (5, 5) of five rows A and the row w of what is told."""
    # Each sum has a register of its own, as in `likelihood.linearize`.
    n00 = n10 = n11 = n20 = n21 = n22 = n30 = n31 = 0.0
    n32 = n33 = n40 = n41 = n42 = n43 = n44 = 0.0
    for panel in range(told.shape[0] // TOLD):
        for lane in range(LANES):
            at, w = panel * TOLD + row * LANES + lane, told[panel * TOLD + weight * LANES + lane]
            a, b, c = told[at], told[at + LANES], told[at + 2 * LANES]
            d, e = told[at + 3 * LANES], told[at + 4 * LANES]
            n00, n10, n20, n30 = n00 + w * a * a, n10 + w * a * b, n20 + w * a * c, n30 + w * a * d
            n11, n21, n31, n41 = n11 + w * b * b, n21 + w * b * c, n31 + w * b * d, n41 + w * b * e
            n22, n32, n42 = n22 + w * c * c, n32 + w * c * d, n42 + w * c * e
            n33, n43, n44, n40 = n33 + w * d * d, n43 + w * d * e, n44 + w * e * e, n40 + w * a * e
    out[0, 0], out[1, 1], out[2, 2], out[3, 3], out[4, 4] = n00, n11, n22, n33, n44
    out[1, 0], out[2, 0], out[3, 0], out[4, 0] = n10, n20, n30, n40
    out[2, 1], out[3, 1], out[4, 1] = n21, n31, n41
    out[3, 2], out[4, 2], out[4, 3] = n32, n42, n43
    for k in range(5):
        for j in range(k):
            out[j, k] = out[k, j]


@sum_kernel
def _total(told: np.ndarray, row: int) -> float:
    total = 0.0
    for panel in range(told.shape[0] // TOLD):
        for lane in range(LANES):
            total += told[panel * TOLD + row * LANES + lane]
    return total
