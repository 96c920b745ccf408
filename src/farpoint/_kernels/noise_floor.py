"""Likelihood of residuals for several values of a noise floor."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inlined_kernel, kernel, sum_kernel

__all__ = ["floor_likelihoods"]


@kernel
def floor_likelihoods(
    squares: np.ndarray, variances: np.ndarray, floors: np.ndarray, freedom: float, rounds: int
) -> np.ndarray:
    """Log likelihood of residuals by Student's distribution, for each floor.

    Parameters
    ----------
    squares : ndarray, shape (N,)
        Squared residuals.
    variances : ndarray, shape (N,)
        Given variances. The variance of a residual is a common factor times the sum of given
        variance and floor. EM estimates the factor in ``rounds`` iterations.
    floors : ndarray, shape (F,)
        Candidate values of the variance that is added to all given variances.
    freedom : float
        Degrees of freedom of Student's distribution.

    Returns
    -------
    ndarray, shape (F,)
    """
    n, likelihoods = len(squares), np.empty(len(floors))
    summed, ratios = np.empty(n), np.empty(n)
    for k in range(len(floors)):
        for i in range(n):
            summed[i] = variances[i] + floors[k]
            ratios[i] = squares[i] / summed[i]
        factor = _sum(ratios) / n
        for _ in range(rounds):
            factor *= _sum_of_weighted(ratios, 1.0 / factor, freedom) / n
        factor = max(factor, 1e-300)
        for i in range(n):
            ratios[i] = 1.0 + ratios[i] / (factor * freedom)
        total = n * math.log(factor) + _sum_of_logs(summed) + (freedom + 1.0) * _sum_of_logs(ratios)
        likelihoods[k] = -0.5 * total
    return likelihoods


@sum_kernel
def _sum(values: np.ndarray) -> float:
    total = 0.0
    for i in range(np.uintp(len(values))):
        total += values[i]
    return total


@sum_kernel
def _sum_of_weighted(ratios: np.ndarray, over_factor: float, freedom: float) -> float:
    """Sum of ``ratio / factor`` times the weight of the ratio in Student's distribution."""
    total = 0.0
    for i in range(np.uintp(len(ratios))):
        scaled = ratios[i] * over_factor
        total += (freedom + 1.0) / (freedom + scaled) * scaled
    return total


@inlined_kernel
def _sum_of_logs(values: np.ndarray) -> float:
    """Sum of the logarithms of the values; one logarithm is computed for the product of four."""
    total, n = 0.0, len(values)
    for i in range(0, n - 3, 4):
        total += math.log(values[i] * values[i + 1] * values[i + 2] * values[i + 3])
    for i in range(n - n % 4, n):
        total += math.log(values[i])
    return total
