"""Noise that scales with parallax.

Near points change size, shape and background between the images, and are therefore tracked less
accurately. On a recorded drive the residuals of the nearest matches are 4 times those of the most
distant matches. If the residuals show this effect, the variance of a match is multiplied by
``sqrt(1 + (p / length)^2)``, where ``p`` is the parallax of the match and ``length`` is the same
for all matches. If p is much smaller than ``length``, the factor is nearly 1. If p is much larger,
the factor is nearly proportional to p, as is the variance of a random walk along the flow.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.arrays import copy
from farpoint._kernels.compile import inlined_kernel, inner_kernel, step_kernel, sum_kernel
from farpoint._kernels.constants import (
    COVARIANCE0,
    FLOW,
    LANES,
    LONGEST_PARALLAX_LENGTH,
    MIN_LOG_RESIDUAL,
    MIN_NOISE_MATCHES,
    MIN_SHARE,
    PARALLAX_LENGTHS,
    SCALING_NOISE_LIMIT,
)
from farpoint._kernels.exponential import lane_log
from farpoint._kernels.pairs import address, flow_variance

__all__ = ["scale_noise_with_parallax"]


class NoiseSamples(NamedTuple):
    """Squared parallaxes and residuals of the matches."""

    flows: np.ndarray
    """Squared parallax, rad^2."""
    logs: np.ndarray
    """Logarithm of the squared residual over the variance."""
    used: np.ndarray
    """1 for an inlier, 0 otherwise."""


@inner_kernel
def scale_noise_with_parallax(
    pairs: np.ndarray,
    residual: np.ndarray,
    parallax: np.ndarray,
    inlier: np.ndarray,
    count: int,
    variance: float,
    scaled_pairs: np.ndarray,
) -> bool:
    """Copy the matches, with noise that scales with parallax, if the residuals show the scaling.

    The length minimises the variance of ``log(r^2 / factor)`` over the inliers, where r is the
    residual and factor is the factor on the variance of the match (module docstring). Heavy tails
    have little influence on the variance of this logarithm. The geometric mean of the factors over
    the inliers is 1, so that likelihoods with and without the factors can be compared.
    ``residual``, ``parallax`` and ``inlier`` are the results of `likelihood.evaluate_residuals`.
    The function returns whether ``scaled_pairs`` was written.
    """
    # The buffers are allocated here, because numba would not free buffers that a called kernel
    # returns.
    samples = NoiseSamples(
        np.empty(residual.size), np.empty(residual.size), np.empty(residual.size)
    )
    total = _collect_samples(pairs, residual, parallax, inlier, count, variance, samples)
    steepness = _fit_steepness(samples, total)
    if steepness > 0.0:
        _scale_noise(pairs, samples, total, steepness, scaled_pairs)
    return steepness > 0.0


@step_kernel
def _collect_samples(
    pairs: np.ndarray,
    residual: np.ndarray,
    parallax: np.ndarray,
    inlier: np.ndarray,
    count: int,
    variance: float,
    samples: NoiseSamples,
) -> float:
    """Fill ``samples``; returns the number of inliers."""
    flows, logs, used = samples.flows, samples.logs, samples.used
    total = 0.0
    for i in range(flows.size):
        is_used = i < count and inlier[i] > 0.5
        used[i] = 1.0 if is_used else 0.0
        total += used[i]
        flows[i] = logs[i] = 0.0
        if i < count:
            flows[i] = parallax[i] * parallax[i] * flow_variance(pairs, address(i))
            square = residual[i] * residual[i] / variance
            logs[i] = math.log(max(square, MIN_LOG_RESIDUAL * MIN_LOG_RESIDUAL))
    return total


@step_kernel
def _fit_steepness(samples: NoiseSamples, total: float) -> float:
    """Inverse squared length, rad^-2, of the best fit to the residuals; 0 for constant noise."""
    mean = _parallax(samples) / max(total, 1.0)
    if total < MIN_NOISE_MATCHES or not mean > 0.0:
        return 0.0
    even = _residual_sum(samples, total, 0.0)
    if not even > 0.0:
        return 0.0
    least, steepness = even, 0.0
    for k in range(PARALLAX_LENGTHS):
        length = LONGEST_PARALLAX_LENGTH * mean * 0.5**k
        left = _residual_sum(samples, total, 1.0 / (length * length))
        if not left < least or _within(samples, length) < MIN_SHARE * total:
            break
        least, steepness = left, 1.0 / (length * length)
    log_ratio = total * math.log(even / max(least, 1e-300))
    return steepness if log_ratio > SCALING_NOISE_LIMIT else 0.0


@step_kernel
def _parallax(samples: NoiseSamples) -> float:
    """Sum of the absolute parallax of inliers, rad."""
    flows, used = samples.flows, samples.used
    whole = 0.0
    for i in range(flows.size):
        whole += used[i] * math.sqrt(flows[i])
    return whole


@inner_kernel
def _within(samples: NoiseSamples, length: float) -> float:
    """Number of inliers whose parallax is smaller than ``length``."""
    flows, used = samples.flows, samples.used
    count = 0.0
    for i in range(flows.size):
        count += used[i] if flows[i] < length * length else 0.0
    return count


@inlined_kernel
def _log_factor(flow2: float, steepness: float) -> float:
    """Logarithm of the factor on the variance at the squared parallax ``flow2``."""
    return 0.5 * lane_log(1.0 + steepness * flow2)


@inner_kernel
def _residual_sum(samples: NoiseSamples, total: float, steepness: float) -> float:
    """Sum of squared deviations of the logarithms from their mean, for a given steepness."""
    first, second = _moments(samples.flows, samples.logs, samples.used, steepness)
    return second - first * first / total


@sum_kernel
def _moments(
    flows: np.ndarray, logs: np.ndarray, used: np.ndarray, steepness: float
) -> tuple[float, float]:
    first = second = 0.0
    for i in range(flows.size):
        left = logs[i] - _log_factor(flows[i], steepness)
        first += used[i] * left
        second += used[i] * left * left
    return first, second


@step_kernel
def _scale_noise(
    pairs: np.ndarray,
    samples: NoiseSamples,
    total: float,
    steepness: float,
    scaled_pairs: np.ndarray,
) -> None:
    flows, used = samples.flows, samples.used
    middle = 0.0
    for i in range(flows.size):
        middle += used[i] * _log_factor(flows[i], steepness)
    usual = math.exp(-middle / total)
    copy(pairs, scaled_pairs)
    for i in range(flows.size):
        factor = usual * math.sqrt(1.0 + steepness * flows[i])
        at = address(i)
        for row in range(COVARIANCE0, FLOW + 1):
            scaled_pairs[at + row * LANES] *= factor
