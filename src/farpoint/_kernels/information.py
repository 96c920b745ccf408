"""Information of the matches on a pose, and the part of the information that is due to noise."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inlined_kernel, inner_kernel, sum_kernel
from farpoint._kernels.constants import (
    DEPTH_CONVERGED,
    EPIPOLE_DISTANCE_SIGMA,
    LANES,
    MAX_ITERATIONS,
    MAX_LEVERAGE,
    PANEL,
    SUMS_OF_FIVE,
    SUMS_OF_SIX,
    TERM_CHANGE,
    TERM_DEPTH,
    TERM_DEPTH_VARIANCE,
    TERM_JACOBIAN,
    TERM_KNOWN,
    TERM_MISSING,
    TERM_RESIDUAL,
    TERM_SCATTER,
    TERM_SHARE,
    TERM_WEIGHT,
    TERMS,
)
from farpoint._kernels.epipolar import flow_along, sampson_jacobian, variances
from farpoint._kernels.mixture import (
    Clutter,
    clutter_at,
    clutter_of,
    densities,
    sum_of,
    weight2_of,
    weight_of,
)
from farpoint._kernels.normal_equations import (
    add_five,
    add_six,
    inverse_square,
    size2,
    write_five,
    write_six,
)
from farpoint._kernels.pairs import flow_variance, ray0, ray1
from farpoint._kernels.pose import LinearisationPoint
from farpoint._kernels.scalars import where
from farpoint._kernels.vectors import (
    Matrix,
    Vector,
    axpby,
    cross,
    dot,
    matrix,
    rotate,
    tangent_columns,
    vector,
)

__all__ = ["information"]


@inner_kernel
def information(
    point: LinearisationPoint,
    shrunk_flow: bool,
    normal: np.ndarray,
    noise: np.ndarray,
    scatter: np.ndarray,
) -> tuple[float, float]:
    """Normal equations ``normal`` (6, 6) of the cost, and the part ``noise`` (5, 5) due to noise.

    ``normal`` is the Gauss-Newton matrix (5, 5), with the gradient in the last column. The Jacobian
    of a match is proportional to the measured flow of the match, so noise of the flow along the
    epipolar line adds to the matrix like true flow. ``noise`` is the expectation of this addition,
    the sum of ``w v C^T C`` over the matches. w is the weight of the match, v is the variance of
    the flow along the epipolar line given the residual, and
    ``C = [(m . t) u, B^T (m x u)] / sqrt(g)`` is the derivative of the Jacobian by this flow. u is
    the unit vector along the epipolar line, B is the tangent basis at t, and m, t and g are those
    of `epipolar`. Matches within `EPIPOLE_DISTANCE_SIGMA` sigma of the epipole are left out,
    because noise alone determines their epipolar lines.

    With ``shrunk_flow`` the inverse depth of each match is replaced by its best linear unbiased
    prediction: a weighted mean of the measured inverse depth and the mean over all matches
    (Robinson, Stat. Sci. 6, 1991, DOI 10.1214/ss/1177011926). The weight of the measured inverse
    depth is ``s = V / (V + v_z)``, where V is the variance of the true inverse depths, and v_z is
    the noise variance of the measured inverse depth. The term of each match in ``noise`` is
    multiplied by ``s^2``. One step of these normal equations from the maximum of the likelihood
    gives an estimate with less variance.

    h is the leverage of a match. The weight of the match is multiplied by ``1 - h^3``, for two
    reasons: if a match has more information than all other matches together, the others cannot
    contradict the match; and the epipolar line of a match near the epipole rotates with every step
    of the pose.

    ``scatter`` (5, 5) is the observed variance of the gradient, with squared residuals divided by
    ``1 - h`` (HC2: MacKinnon and White, J. Econom. 29, 1985, DOI 10.1016/0304-4076(85)90158-7). The
    expectation of ``scatter`` is the Gauss-Newton matrix if the noise model is true.

    The function returns two numbers: the share of the information that remains although the mixture
    component of each match is unknown (Louis, J. R. Stat. Soc. B 44, 1982, DOI
    10.1111/j.2517-6161.1982.tb01203.x), and the effective number of matches ``(sum h)^2 / sum
    h^2``.
    """
    terms = np.empty(point.prior.size // LANES * TERMS)
    _fill_terms(point, terms)
    if shrunk_flow:
        _shrink_depths(terms)
    _normal_equations(terms, normal)
    effective = _weigh_by_leverage(terms, normal)
    _normal_equations(terms, normal)
    _gram(terms, TERM_CHANGE, TERM_SHARE, noise)
    _gram(terms, TERM_JACOBIAN, TERM_SCATTER, scatter)
    known, missing = _total(terms, TERM_KNOWN), _total(terms, TERM_MISSING)
    return 1.0 - missing / known if known > 0.0 else 1.0, effective


@inner_kernel
def _shrink_depths(terms: np.ndarray) -> None:
    """Replace inverse depths by their best linear unbiased prediction, and adapt the Jacobians."""
    mean, variance = 0.0, 0.0
    for k in range(MAX_ITERATIONS):
        total, weighted, weight2, excess = _depth_moments(
            terms, mean, variance, 1.0 if k == 0 else 0.0
        )
        if not (total > 0.0 and weight2 > 0.0):
            return
        before = variance
        mean = weighted / total if k > 0 else 0.0
        variance = max(excess / weight2, 0.0)
        if k > 1 and abs(variance - before) <= DEPTH_CONVERGED * variance:
            break
    for panel in range(terms.size // TERMS):
        for lane in range(LANES):
            at = panel * TERMS + lane
            depth, depth_variance = (
                terms[at + TERM_DEPTH * LANES],
                terms[at + TERM_DEPTH_VARIANCE * LANES],
            )
            own = variance / (variance + depth_variance + 1e-300)
            terms[at + TERM_SHARE * LANES] *= own * own
            for row in range(5):
                change = terms[at + (TERM_CHANGE + row) * LANES]
                terms[at + row * LANES] += (1.0 - own) * (mean - depth) * change


@sum_kernel
def _depth_moments(
    terms: np.ndarray, mean: float, variance: float, first: float
) -> tuple[float, float, float, float]:
    """Sums for the method of moments of the inverse depths.

    The function returns the sums of ``w``, ``w d``, ``v`` and ``v ((d - mean)^2 - s^2)``, where d
    is an inverse depth and s^2 its noise variance. With the robust weight k of the match,
    ``w = k / (variance + s^2)`` and ``v = w / (variance + s^2)``. In the first round (``first`` 1,
    ``mean`` and ``variance`` 0) v equals w, and s^2 is not subtracted.
    """
    total = weighted = weight2 = excess = 0.0
    for panel in range(terms.size // TERMS):
        for lane in range(LANES):
            at = panel * TERMS + lane
            depth, depth_variance = (
                terms[at + TERM_DEPTH * LANES],
                terms[at + TERM_DEPTH_VARIANCE * LANES],
            )
            over = 1.0 / (variance + depth_variance + 1e-300)
            w = terms[at + TERM_KNOWN * LANES] * over
            each = w * (first + (1.0 - first) * over)
            total += w
            weighted += w * depth
            weight2 += each
            excess += each * ((depth - mean) ** 2 - (1.0 - first) * depth_variance)
    return total, weighted, weight2, excess


@inner_kernel
def _fill_terms(point: LinearisationPoint, terms: np.ndarray) -> None:
    """Fill the panels of ``terms``, whose rows are the constants ``TERM_...``, for all matches."""
    rotation, direction = matrix(point.R), vector(point.t)
    basis = tangent_columns(direction)
    noise = (
        1.0 / point.mixture[0],
        point.mixture[2],
        clutter_of(point.mixture, point.outlier_half_width),
        point.long_tail,
    )
    for panel in range(point.prior.size // LANES):
        for lane in range(LANES):
            at, to = panel * PANEL + lane, panel * TERMS + lane
            share = point.prior[panel * LANES + lane]
            _fill_match(point.pairs, at, share, rotation, direction, basis, noise, terms, to)


@inlined_kernel
def _fill_match(
    pairs: np.ndarray,
    at: int,
    prior: float,
    R: Matrix,
    t: Vector,
    basis: tuple[Vector, Vector],
    noise: tuple[float, float, Clutter, float],
    terms: np.ndarray,
    to: int,
) -> None:
    """Fill the terms of one match, a column of a panel from the index ``to`` on."""
    precision, tail_share, clutter, long_tail = noise
    jacobian = sampson_jacobian(pairs, at, R, t, basis)
    r = jacobian[5]
    m = rotate(R, ray0(pairs, at))
    reach = dot(m, t)
    along = axpby(reach, t, -reach * reach, m)
    across = cross(m, t)
    each = densities(pairs, at, R, t, r, precision, tail_share, prior, long_tail)
    flow, square = flow_along(m, ray1(pairs, at), t)
    elsewhere = square > EPIPOLE_DISTANCE_SIGMA**2 / precision * flow_variance(pairs, at)
    outlier, _ = clutter_at(clutter, r)
    over = where(elsewhere, 1.0 / (sum_of(each) + outlier), 0.0)
    w, w2 = weight_of(each) * over, weight2_of(each) * over
    g, v = variances(pairs, at, R, t)
    scale = 1.0 / math.sqrt(g)
    x, y, z = axpby(scale, along, 0.0, along)
    change = x, y, z, scale * dot(basis[0], across), scale * dot(basis[1], across)
    over_square = 1.0 / (square + 1e-150)
    depth, depth_variance = flow * over_square, v * over_square * over_square / precision
    weight = w * precision
    missing, scatter = r * r * precision * (w2 - w * w), weight * r * weight * r
    weights = weight, weight * depth_variance, w, missing, scatter, depth, depth_variance
    _write_rows(terms, to, jacobian)
    _write_rows(terms, to + TERM_CHANGE * LANES, change)
    _write_rows(terms, to + TERM_WEIGHT * LANES, weights)


@inlined_kernel
def _write_rows(terms: np.ndarray, to: int, values: tuple[float, ...]) -> None:
    """Write the numbers of a match, one number per row."""
    for row in range(len(values)):
        terms[to + row * LANES] = values[row]


@inner_kernel
def _weigh_by_leverage(terms: np.ndarray, whole: np.ndarray) -> float:
    """Multiply the weights by ``1 - h^3``, where h is the leverage of the match.

    The scatter is multiplied by ``(1 - h^3) / (1 - h)``. The function returns the effective number
    of matches ``(sum h)^2 / sum h^2``.
    """
    inverse, positive = inverse_square(whole)
    if not positive:
        return 0.0
    total = squares = 0.0
    for panel in range(terms.size // TERMS):
        for lane in range(LANES):
            at = panel * TERMS + lane
            leverage = min(terms[at + TERM_WEIGHT * LANES] * size2(inverse, _five(terms, at)), 1.0)
            total += leverage
            squares += leverage * leverage
            kept = 1.0 - leverage * leverage * leverage
            terms[at + TERM_WEIGHT * LANES] *= kept
            terms[at + TERM_SHARE * LANES] *= kept
            terms[at + TERM_SCATTER * LANES] *= kept / (1.0 - min(leverage, MAX_LEVERAGE))
    return total * total / max(squares, 1e-300)


@sum_kernel
def _gram(terms: np.ndarray, row: int, weight: int, out: np.ndarray) -> None:
    """``A diag(w) A^T`` (5, 5) for five rows A and one row w of the terms."""
    sums = SUMS_OF_FIVE
    for panel in range(terms.size // TERMS):
        for lane in range(LANES):
            at = panel * TERMS + lane
            sums = add_five(sums, terms[at + weight * LANES], _five(terms, at + row * LANES))
    write_five(sums, out)


@sum_kernel
def _normal_equations(terms: np.ndarray, out: np.ndarray) -> None:
    """``A diag(w) A^T`` (6, 6), with the rows A of Jacobian and residual, and the weights w."""
    sums = SUMS_OF_SIX
    for panel in range(terms.size // TERMS):
        for lane in range(LANES):
            at = panel * TERMS + lane
            x, y, z, u, v = _five(terms, at)
            row = x, y, z, u, v, terms[at + TERM_RESIDUAL * LANES]
            sums = add_six(sums, terms[at + TERM_WEIGHT * LANES], row)
    write_six(sums, out)


@inlined_kernel
def _five(terms: np.ndarray, at: int) -> tuple[float, float, float, float, float]:
    a, b, c = terms[at], terms[at + LANES], terms[at + 2 * LANES]
    return a, b, c, terms[at + 3 * LANES], terms[at + 4 * LANES]


@inner_kernel
def _total(terms: np.ndarray, row: int) -> float:
    total = 0.0
    for panel in range(terms.size // TERMS):
        for lane in range(LANES):
            total += terms[panel * TERMS + row * LANES + lane]
    return total
