"""How the noise of a match grows with its parallax.

What is near moves far, changes its size and shape and what is behind it from one image to the next,
and is followed the less well: on a drive the residuals of the nearest matches are four times those
of the farthest. Where the residuals show it, the variance of a match is multiplied by
``sqrt(1 + (p / length)^2)``, with its parallax ``p`` and one length for all: it stays what it is up
to this parallax, and grows with it from there on, as that of a random walk along the flow would.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.arrays import copy
from farpoint._kernels.compile import inlined_kernel, inner_kernel, step_kernel, sum_kernel
from farpoint._kernels.exponential import lane_log
from farpoint._kernels.pairs import COVARIANCE0, FLOW, LANES, address, flow_variance

__all__ = ["scale_noise_with_parallax"]

# Length that is tried first, times the mean parallax; each other is half of the one before.
LONGEST_LENGTH = 4.0
LENGTHS = 9
# Share of the matches that must have less parallax: few tell nothing of how the noise is below it.
MIN_SHARE_WITHIN = 0.1
# Twice the log likelihood ratio that chance makes of a growth once in two thousand times.
CHANCE_LIMIT = 11.0
MIN_INLIERS = 30.0
# A residual that is smaller, over the sigma, says no more.
MIN_RESIDUAL = 0.1


class NoiseSamples(NamedTuple):
    """What the matches tell of their noise."""

    flows: np.ndarray
    """Squared parallax, rad^2."""
    logs: np.ndarray
    """Logarithm of the squared residual, in units of the noise of all."""
    used: np.ndarray
    """1 for a right match, 0 for any other."""


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
    """Copy the matches to ``scaled_pairs`` with noise that grows, if the residuals show that it does.

    The length is that of least squares of the logarithms of the squared residuals, which tails draw
    but little. The factors' geometric mean over the right matches is 1: likelihoods of the same
    matches, with noise that grows and with noise that does not, can be compared.
    ``residual``, ``parallax`` and ``inlier`` are those of `likelihood.evaluate_residuals`.
    """
    # A kernel that handed back what it has made room for would keep it.
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
    """Fill ``samples``; the number of right matches."""
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
            logs[i] = math.log(max(square, MIN_RESIDUAL * MIN_RESIDUAL))
    return total


@step_kernel
def _fit_steepness(samples: NoiseSamples, total: float) -> float:
    """One over the squared length, rad^-2, that explains the residuals best; 0 for no growth."""
    mean = _parallax(samples) / max(total, 1.0)
    if total < MIN_INLIERS or not mean > 0.0:
        return 0.0
    even = _residual_sum(samples, total, 0.0)
    if not even > 0.0:
        return 0.0
    least, steepness = even, 0.0
    for k in range(LENGTHS):
        length = LONGEST_LENGTH * mean * 0.5**k
        left = _residual_sum(samples, total, 1.0 / (length * length))
        if not left < least or _within(samples, length) < MIN_SHARE_WITHIN * total:
            break
        least, steepness = left, 1.0 / (length * length)
    log_ratio = total * math.log(even / max(least, 1e-300))
    return steepness if log_ratio > CHANCE_LIMIT else 0.0


@step_kernel
def _parallax(samples: NoiseSamples) -> float:
    """Of all right matches together, rad."""
    flows, used = samples.flows, samples.used
    whole = 0.0
    for i in range(flows.size):
        whole += used[i] * math.sqrt(flows[i])
    return whole


@inner_kernel
def _within(samples: NoiseSamples, length: float) -> float:
    """Right matches of less parallax."""
    flows, used = samples.flows, samples.used
    count = 0.0
    for i in range(flows.size):
        count += used[i] if flows[i] < length * length else 0.0
    return count


@inlined_kernel
def _log_factor(flow2: float, steepness: float) -> float:
    """Of the variance of a match of this squared parallax."""
    return 0.5 * lane_log(1.0 + steepness * flow2)


@inner_kernel
def _residual_sum(samples: NoiseSamples, total: float, steepness: float) -> float:
    """Sum of squares of what growth of this steepness leaves of the logarithms."""
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
