"""A pose with the noise that it needs, what it is judged by, and a step of it."""

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
    """What a pose is judged by: matches as the kernels take them, with what is known of all."""

    pairs: np.ndarray
    """Panels of matches."""
    prior: np.ndarray
    """Of each match, by what its share of being right is scaled; 0 leaves it out."""
    total: int
    """Matches."""
    outlier_half_width: float
    """Half the width that wrong matches fill, in units of the noise."""
    long_tail: float
    """`mixture.LONG_TAIL` or `mixture.SHORT_TAIL`."""
    min_variance: float
    """Smaller noise is rounding."""
    max_variance: float
    """Larger noise is not believed, and none is poor; infinite where both are as they are found."""
    soft_cheirality: bool
    """Whether a pose does to matches that retreat. Motions that are held against each other do not:
    each match may retreat by `mixture.CHEIRALITY_SIGMA` at no cost, and the reverse of a motion would make
    use of that."""


class Pose(NamedTuple):
    """A pose with the noise that it needs."""

    R: np.ndarray
    """(3, 3) rotation cam1_from_cam0."""
    t: np.ndarray
    """(3,) direction cam1_from_cam0."""
    mixture: np.ndarray
    """(4,) variance of good matches, share of wrong ones among all, of poor ones among the right
    ones, and of repeated ones among the wrong ones."""
    normal: np.ndarray
    """(6, 6) normal equations, as of `likelihood.linearize`."""
    cost: np.ndarray
    """(1,) negative log likelihood."""


class LinearisationPoint(NamedTuple):
    """Matches as a pose sees them: all that their likelihood is made of."""

    pairs: np.ndarray
    """Panels of matches."""
    prior: np.ndarray
    """As of `PackedMatches`."""
    R: np.ndarray
    """(3, 3) rotation cam1_from_cam0."""
    t: np.ndarray
    """(3,) direction cam1_from_cam0."""
    mixture: np.ndarray
    """As of `Pose`."""
    outlier_half_width: float
    """As of `PackedMatches`."""
    long_tail: float
    """As of `PackedMatches`."""


@step_kernel
def linearisation_point(
    matches: PackedMatches, R: np.ndarray, t: np.ndarray, mixture: np.ndarray
) -> LinearisationPoint:
    """The matches as a pose sees them."""
    outlier_half_width, long_tail = matches.outlier_half_width, matches.long_tail
    return LinearisationPoint(
        matches.pairs, matches.prior, R, t, mixture, outlier_half_width, long_tail
    )


@inner_kernel
def copy_pose(pose: Pose, target: Pose) -> None:
    """All of it."""
    copy_motion(pose.R, pose.t, target.R, target.t)
    for k in range(4):
        target.mixture[k] = pose.mixture[k]
    for i in range(6):
        for j in range(6):
            target.normal[i, j] = pose.normal[i, j]
    target.cost[0] = pose.cost[0]


@inner_kernel
def copy_motion(R: np.ndarray, t: np.ndarray, target_R: np.ndarray, target_t: np.ndarray) -> None:
    """Rotation and direction."""
    for i in range(3):
        target_t[i] = t[i]
        for j in range(3):
            target_R[i, j] = R[i, j]


@inner_kernel
def apply_step(R: np.ndarray, t: np.ndarray, x: np.ndarray) -> None:
    """Move the pose by ``x = [dtheta (3), dbeta (2)]`` in place."""
    apply_rotation_step(R, x[0], x[1], x[2], R)
    _apply_direction_step(t, x[3], x[4])


@inner_kernel
def take_step(R: np.ndarray, t: np.ndarray, x: np.ndarray, size2: float) -> None:
    """Move the pose against ``x``, of this squared length, by 0.3 at the most."""
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
