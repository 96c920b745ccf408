"""Likelihood of residuals for several values of a noise floor."""

from __future__ import annotations

import math

import numba
import numpy as np

__all__ = ["floor_likelihoods"]


@numba.njit(cache=True, error_model="numpy")
def floor_likelihoods(
    squares: np.ndarray, variances: np.ndarray, floors: np.ndarray, freedom: float, rounds: int
) -> np.ndarray:
    """Log likelihood of residuals by Student's distribution, for each floor.

    Parameters
    ----------
    squares : ndarray, shape (N,)
        Squared residuals.
    variances : ndarray, shape (N,)
        Given variances, up to a common factor, which EM estimates in ``rounds`` iterations.
    floors : ndarray, shape (F,)
        Candidate values of the variance that is added to all given variances.
    freedom : float
        Degrees of freedom of Student's distribution.

    Returns
    -------
    ndarray, shape (F,)
    """
    likelihoods = np.empty(len(floors))
    n = len(squares)
    ratios = np.empty(n)
    for k in range(len(floors)):
        factor = 0.0
        for i in range(n):
            ratios[i] = squares[i] / (variances[i] + floors[k])
            factor += ratios[i] / n
        for _ in range(rounds):
            mean = 0.0
            for i in range(n):
                scaled = ratios[i] / factor
                mean += (freedom + 1.0) / (freedom + scaled) * scaled
            factor *= mean / n
        factor = max(factor, 1e-300)
        total = 0.0
        for i in range(n):
            total += math.log(factor * (variances[i] + floors[k]))
            total += (freedom + 1.0) * math.log1p(ratios[i] / factor / freedom)
        likelihoods[k] = -0.5 * total
    return likelihoods
