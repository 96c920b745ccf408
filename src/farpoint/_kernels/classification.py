"""Classification of matches by a mixture of two motions and outliers."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import kernel, step_kernel
from farpoint._kernels.constants import EM_ROUNDS, ROUNDING

__all__ = ["classify"]


@kernel
def classify(densities: np.ndarray, follows: np.ndarray, log_likelihoods: np.ndarray) -> None:
    """Component that each match follows, and its classification log likelihood.

    EM estimates the shares of the three components. The classification log likelihood of a match is
    its log likelihood under the mixture minus the entropy of its responsibilities (Biernacki,
    Celeux and Govaert, IEEE PAMI 22, 2000, DOI 10.1109/34.865189).

    Parameters
    ----------
    densities : ndarray, shape (3, N)
        Log density of each match under each component. The function overwrites the array.
    follows : ndarray of int64, shape (N,)
        Receives the index of the component with the largest responsibility.
    log_likelihoods : ndarray, shape (N,)
        Receives the classification log likelihoods.
    """
    count = densities.shape[1]
    for i in range(count):
        largest = max(densities[0, i], densities[1, i], densities[2, i])
        log_likelihoods[i] = largest
        for k in range(3):
            densities[k, i] = math.exp(densities[k, i] - largest)
    shares, before, sums = np.full(3, 1.0 / 3.0), np.empty(3), np.empty(3)
    for _ in range(EM_ROUNDS):
        for k in range(3):
            before[k], sums[k] = shares[k], 0.0
        for i in range(count):
            total = _total(densities, i, shares)
            for k in range(3):
                sums[k] += shares[k] * densities[k, i] / total
        for k in range(3):
            shares[k] = max(sums[k] / count, ROUNDING)
    for i in range(count):  # with the shares of the last expectation
        total, most = _total(densities, i, before), -1.0
        log_likelihoods[i] += math.log(total)
        for k in range(3):
            responsibility = before[k] * densities[k, i] / total
            log_likelihoods[i] += responsibility * math.log(max(responsibility, ROUNDING))
            if responsibility > most:
                follows[i], most = k, responsibility


@step_kernel
def _total(densities: np.ndarray, i: int, shares: np.ndarray) -> float:
    return shares[0] * densities[0, i] + shares[1] * densities[1, i] + shares[2] * densities[2, i]
