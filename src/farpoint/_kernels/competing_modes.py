"""Other modes of the likelihood: nearly as likely, with another direction of translation.

With little parallax, a rotation can explain most of the flow of a translation, and another
translation explains the remaining flow. The likelihood then has several maxima, and the covariance
at each maximum is small. `likeliest_other_mode` searches for such a maximum with a subsample of the
matches. `compare_with_mode` computes the log-likelihood ratio again with more matches.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.arrays import copy
from farpoint._kernels.compile import inner_kernel, kernel, step_kernel
from farpoint._kernels.constants import (
    COARSE_STEPS,
    COS_SAME_MODE,
    GOLDEN_ANGLE,
    MODE_MARGIN,
    START_DIRECTIONS,
)
from farpoint._kernels.hypothesis_comparison import refine, refine_if_competitive
from farpoint._kernels.pose import PackedMatches, Pose, copy_pose
from farpoint._kernels.vectors import dot, vector

__all__ = ["compare_with_mode", "likeliest_other_mode"]


@kernel
def likeliest_other_mode(
    matches: PackedMatches, pose: Pose, start_R: np.ndarray, mode: Pose
) -> float:
    """Log-likelihood ratio of a pose to the likeliest mode in another direction.

    Both likelihoods are averaged over nearby poses (Laplace). Refinements start at the rotation
    ``start_R`` (3, 3), each with another one of `START_DIRECTIONS` directions, and with the noise
    parameters of ``pose``. ``mode`` receives the likeliest mode. The ratio is infinite if no mode
    whose direction is more than 30 degrees (`COS_SAME_MODE`) from that of ``pose`` has a
    log-likelihood ratio below `MODE_MARGIN`. The pose is also refined before the comparison, but
    ``pose`` itself stays unchanged.
    """
    own = Pose(np.empty((3, 3)), np.empty(3), np.empty(4), np.empty((6, 6)), np.empty(1))
    other = Pose(np.empty((3, 3)), np.empty(3), np.empty(4), np.empty((6, 6)), np.empty(1))
    _refine_from(matches, pose.R, pose.t, pose.mixture, own)
    mode.cost[0] = math.inf
    start_t = np.empty(3)
    for k in range(START_DIRECTIONS):
        _lattice_direction(k, start_t)
        _start_from(start_R, start_t, pose.mixture, other)
        competes, _ = refine_if_competitive(matches, other, own, MODE_MARGIN)
        if competes and other.cost[0] < mode.cost[0] and _has_other_direction(other, pose):
            copy_pose(other, mode)
    return mode.cost[0] - own.cost[0]


@kernel
def compare_with_mode(matches: PackedMatches, pose: Pose, mode: Pose) -> float:
    """Log-likelihood ratio of a pose to a given mode, which is refined in place.

    The ratio compares two local maxima of the likelihood: one refined from a copy of ``pose``, the
    other refined from ``mode`` and written to ``mode``. Both refinements start with the noise
    parameters of ``pose``. The ratio is infinite if the direction of the refined mode is within 30
    degrees (`COS_SAME_MODE`) of that of ``pose``.
    """
    own = Pose(np.empty((3, 3)), np.empty(3), np.empty(4), np.empty((6, 6)), np.empty(1))
    _refine_from(matches, pose.R, pose.t, pose.mixture, own)
    _refine_from(matches, mode.R, mode.t, pose.mixture, mode)
    return mode.cost[0] - own.cost[0] if _has_other_direction(mode, pose) else math.inf


@inner_kernel
def _refine_from(
    matches: PackedMatches, R: np.ndarray, t: np.ndarray, mixture: np.ndarray, pose: Pose
) -> None:
    """Local maximum ``pose`` of the likelihood, refined from ``R``, ``t`` and ``mixture``."""
    _start_from(R, t, mixture, pose)
    refine(matches, COARSE_STEPS, pose)


@inner_kernel
def _start_from(R: np.ndarray, t: np.ndarray, mixture: np.ndarray, pose: Pose) -> None:
    copy(R, pose.R)
    copy(t, pose.t)
    copy(mixture, pose.mixture)


@inner_kernel
def _has_other_direction(mode: Pose, pose: Pose) -> bool:
    return dot(vector(mode.t), vector(pose.t)) < COS_SAME_MODE


@step_kernel
def _lattice_direction(k: int, t: np.ndarray) -> None:
    """Write the k-th of `START_DIRECTIONS` evenly spaced directions (Fibonacci lattice)."""
    z, angle = (2.0 * k + 1.0) / START_DIRECTIONS - 1.0, k * GOLDEN_ANGLE
    radius = math.sqrt(1.0 - z * z)
    t[0], t[1], t[2] = radius * math.cos(angle), radius * math.sin(angle), z
