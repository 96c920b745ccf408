"""The motion in quite another direction that is nearly as likely as the one that was found.

Where little is seen of a translation, a rotation can take its place and leave it the other way
round: each such motion is sure of itself, and neither knows of the other. Some matches are enough
to find such a rival, and more of them to judge it.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.arrays import copy
from farpoint._kernels.compile import inner_kernel, kernel, step_kernel
from farpoint._kernels.hypothesis_comparison import (
    MODE_MARGIN,
    REFINEMENTS,
    refine,
    refine_if_competitive,
)
from farpoint._kernels.pose import PackedMatches, Pose, copy_pose
from farpoint._kernels.vectors import dot, vector

__all__ = ["compare_with_mode", "likeliest_other_mode"]

# Directions from which a rival is looked for, evenly over the sphere.
STARTS = 12
GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))
# Cosine of the angle from which on a motion is another one.
MAX_COSINE = math.cos(math.radians(30.0))


@kernel
def likeliest_other_mode(
    matches: PackedMatches, pose: Pose, start_R: np.ndarray, mode: Pose
) -> float:
    """By how much the likeliest motion elsewhere is less likely than this one, in log likelihood.

    Both averaged over the poses nearby. It is looked for from the rotation ``start_R`` (3, 3), with
    directions all over the sphere, and the noise of ``pose``, which stays as it is. ``mode``
    receives it; infinite where there is none that comes near, as of `hypothesis_comparison.refine_if_competitive`.
    """
    own = Pose(np.empty((3, 3)), np.empty(3), np.empty(4), np.empty((6, 6)), np.empty(1))
    other = Pose(np.empty((3, 3)), np.empty(3), np.empty(4), np.empty((6, 6)), np.empty(1))
    _refine_from(matches, pose.R, pose.t, pose.mixture, own)
    mode.cost[0] = math.inf
    start_t = np.empty(3)
    for k in range(STARTS):
        _place(k, start_t)
        _start_from(start_R, start_t, pose.mixture, other)
        competes, _ = refine_if_competitive(matches, other, own, MODE_MARGIN)
        if competes and other.cost[0] < mode.cost[0] and _has_other_direction(other, pose):
            copy_pose(other, mode)
    return mode.cost[0] - own.cost[0]


@kernel
def compare_with_mode(matches: PackedMatches, pose: Pose, mode: Pose) -> float:
    """What `likeliest_other_mode` does, of a rival that is known, and refined in place."""
    own = Pose(np.empty((3, 3)), np.empty(3), np.empty(4), np.empty((6, 6)), np.empty(1))
    _refine_from(matches, pose.R, pose.t, pose.mixture, own)
    _refine_from(matches, mode.R, mode.t, pose.mixture, mode)
    return mode.cost[0] - own.cost[0] if _has_other_direction(mode, pose) else math.inf


@inner_kernel
def _refine_from(
    matches: PackedMatches, R: np.ndarray, t: np.ndarray, mixture: np.ndarray, pose: Pose
) -> None:
    """The motion that this one leads to, with the noise that it needs."""
    _start_from(R, t, mixture, pose)
    refine(matches, REFINEMENTS, pose)


@inner_kernel
def _start_from(R: np.ndarray, t: np.ndarray, mixture: np.ndarray, pose: Pose) -> None:
    copy(R, pose.R)
    copy(t, pose.t)
    copy(mixture, pose.mixture)


@inner_kernel
def _has_other_direction(mode: Pose, pose: Pose) -> bool:
    return dot(vector(mode.t), vector(pose.t)) < MAX_COSINE


@step_kernel
def _place(k: int, t: np.ndarray) -> None:
    """The k-th of directions that are evenly spread (a Fibonacci lattice)."""
    z, angle = (2.0 * k + 1.0) / STARTS - 1.0, k * GOLDEN_ANGLE
    radius = math.sqrt(1.0 - z * z)
    t[0], t[1], t[2] = radius * math.cos(angle), radius * math.sin(angle), z
