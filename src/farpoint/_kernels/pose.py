"""Pose with its noise parameters, packed matches, and steps on the manifold."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.compile import inner_kernel, step_kernel
from farpoint._kernels.linear import apply_rotation_step
from farpoint._kernels.vectors import axpby, dot, tangent_columns, vector

__all__ = [
    "LinearisationPoint",
    "PackedMatches",
    "Pose",
    "apply_step",
    "copy_motion",
    "copy_pose",
    "linearisation_point",
    "take_step",
]


class PackedMatches(NamedTuple):
    """Matches in panels, with the prior of each match and bounds of the noise."""

    pairs: np.ndarray
    """Panels of matches; see `pairs`."""
    prior: np.ndarray
    """Factor on the inlier density of each match; 0 leaves the match out."""
    odds: np.ndarray
    """Prior odds of each match, divided by those of all matches; 0 for filler."""
    total: int
    """Number of matches."""
    outlier_half_width: float
    """Half-width of the strip of outliers about an epipolar line, in the unit of the noise
    sigma."""
    long_tail: float
    """`constants.LONG_TAIL` or `constants.SHORT_TAIL`."""
    min_variance: float
    """Lower bound of the noise variance, due to rounding, in the squared unit of the noise
    sigma."""
    max_variance: float
    """Upper bound of the noise variance. A finite bound excludes a heavy tail; an infinite bound
    leaves variance and tail free."""
    soft_cheirality: bool
    """Whether the cheirality penalty is a residual of the refinement.

    False for comparisons of modes: with the residual, the refinement of a motion with reversed
    direction would find a pose at which all matches have a small negative parallax, and the penalty
    is 0 for a parallax above -`CHEIRALITY_SIGMA` sigma.
    """


class Pose(NamedTuple):
    """A pose with noise parameters and the linearisation of the likelihood."""

    R: np.ndarray
    """(3, 3) rotation cam1_from_cam0."""
    t: np.ndarray
    """(3,) unit direction of translation, cam1_from_cam0."""
    mixture: np.ndarray
    """(4,) noise variance of the core; share of outliers among all matches, of the tail among
    inliers, and of repeated structure among outliers."""
    normal: np.ndarray
    """(6, 6) normal equations; see `likelihood.linearize`."""
    cost: np.ndarray
    """(1,) negative log likelihood; in the search, plus the Laplace factor."""


class LinearisationPoint(NamedTuple):
    """Linearisation point of the likelihood: matches, pose and noise parameters."""

    pairs: np.ndarray
    """Panels of matches."""
    prior: np.ndarray
    """See `PackedMatches`."""
    R: np.ndarray
    """(3, 3) rotation cam1_from_cam0."""
    t: np.ndarray
    """(3,) unit direction of translation, cam1_from_cam0."""
    mixture: np.ndarray
    """See `Pose`."""
    outlier_half_width: float
    """See `PackedMatches`."""
    long_tail: float
    """See `PackedMatches`."""


@step_kernel
def linearisation_point(
    matches: PackedMatches, R: np.ndarray, t: np.ndarray, mixture: np.ndarray
) -> LinearisationPoint:
    """Linearisation point of the likelihood of ``matches`` at a pose."""
    outlier_half_width, long_tail = matches.outlier_half_width, matches.long_tail
    return LinearisationPoint(
        matches.pairs, matches.prior, R, t, mixture, outlier_half_width, long_tail
    )


@inner_kernel
def copy_pose(pose: Pose, target: Pose) -> None:
    """Copy every field of a pose."""
    copy_motion(pose.R, pose.t, target.R, target.t)
    for k in range(4):
        target.mixture[k] = pose.mixture[k]
    for i in range(6):
        for j in range(6):
            target.normal[i, j] = pose.normal[i, j]
    target.cost[0] = pose.cost[0]


@inner_kernel
def copy_motion(R: np.ndarray, t: np.ndarray, target_R: np.ndarray, target_t: np.ndarray) -> None:
    """Copy rotation and direction."""
    for i in range(3):
        target_t[i] = t[i]
        for j in range(3):
            target_R[i, j] = R[i, j]


@inner_kernel
def apply_step(R: np.ndarray, t: np.ndarray, x: np.ndarray) -> None:
    """Retract the pose by ``x = [dtheta (3), dbeta (2)]``, rad, in place."""
    apply_rotation_step(R, x[0], x[1], x[2], R)
    _apply_direction_step(t, x[3], x[4])


@inner_kernel
def take_step(R: np.ndarray, t: np.ndarray, x: np.ndarray, size2: float) -> None:
    """Retract the pose by ``-x``, with squared length ``size2``, limited to a step of 0.3 rad."""
    scale = -1.0 if size2 < 0.09 else -0.3 / math.sqrt(size2)
    for k in range(5):
        x[k] *= scale
    apply_step(R, t, x)


@step_kernel
def _apply_direction_step(t: np.ndarray, x: float, y: float) -> None:
    first, second = tangent_columns(vector(t))
    moved = axpby(1.0, vector(t), 1.0, axpby(x, first, y, second))
    scale = 1.0 / math.sqrt(dot(moved, moved))
    t[0], t[1], t[2] = scale * moved[0], scale * moved[1], scale * moved[2]
