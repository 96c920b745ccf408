"""A pose on its way to the maximum of its likelihood, step by step, with its noise by EM."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.compile import inner_kernel, kernel
from farpoint._kernels.formulas import greater, lesser
from farpoint._kernels.likelihood import judge_pose
from farpoint._kernels.mixture import repeated_share, unusual, update_mixture
from farpoint._kernels.pose import PackedMatches, Pose, copy_pose, take_step
from farpoint._kernels.scratch import copy, scratch
from farpoint._kernels.squares import promise, solve_five_spd

__all__ = ["PROMISED", "Refinement", "advance", "begin", "finish", "refine_pose"]

# What EM with unbiased variance may climb; a step that climbs more has gone astray.
CLIMB = 0.5

# Share of poor matches where none is believed to be: its logarithm is asked for.
NONE = 1e-9

# What is kept from step to step: the lowest cost so far, the weighted squares of the residuals for
# each right match there, how much steps are damped, how far EM goes, and what the last step
# promises, in log likelihood.
LOWEST, SQUARE, DAMPING, HASTE, PROMISED = range(5)


class Refinement(NamedTuple):
    """A pose that is being refined."""

    pose: Pose
    """Where it is; with the normal equations and the cost of where it was."""
    lowest: Pose
    """The likeliest so far."""
    shares: np.ndarray
    """(4,) as of `likelihood.linearize`."""
    lowest_shares: np.ndarray
    """(4,) those of the likeliest so far."""
    state: np.ndarray
    """(5,) numbers that are kept from step to step."""


@kernel
def refine_pose(matches: PackedMatches, precision: float, max_iterations: int, pose: Pose) -> None:
    """Maximum-likelihood pose, with its noise by EM.

    Gauss-Newton with the full derivative of the residual, and where the pose gives way to matches
    that retreat, of their shifts. ``pose`` holds the start, with its mixture, and receives the end,
    from which a step promises less than ``precision``, in the unit of the log likelihood; with the
    normal equations and the cost there.
    """
    lowest = Pose(scratch(3, 3), scratch(3), scratch(4), scratch(6, 6), scratch(1))
    refinement = Refinement(pose, lowest, scratch(4), scratch(4), scratch(5))
    begin(matches, refinement)
    for _ in range(max_iterations):
        if not advance(matches, precision, refinement):
            break
    finish(refinement)


@inner_kernel
def begin(matches: PackedMatches, refinement: Refinement) -> None:
    """From where the pose is, with as much of its noise as is believed."""
    state = refinement.state
    _believe(matches, refinement.pose.mixture)
    state[LOWEST] = state[SQUARE] = math.inf
    state[DAMPING], state[HASTE], state[PROMISED] = 0.0, 1.0, 0.0


@inner_kernel
def advance(matches: PackedMatches, precision: float, refinement: Refinement) -> bool:
    """Judge the pose and take a step; False where there is none that promises enough."""
    pose, lowest, state = refinement.pose, refinement.lowest, refinement.state
    mixture, normal, shares = pose.mixture, pose.normal, refinement.lowest_shares
    x, count, variance = scratch(5), float(matches.total), mixture[0]
    pose.cost[0] = judge_pose(matches, pose, refinement.shares)
    judged = pose.cost[0] + unusual(mixture[2]) + unusual(mixture[3])
    if judged > state[LOWEST] + CLIMB:
        copy_pose(lowest, pose)
        # Either the noise or the pose went too far: the noise first.
        if state[HASTE] == 0.0:
            state[DAMPING] = greater(100.0 * state[DAMPING], 1e-2)
        state[HASTE] = 0.0
    else:
        copy_pose(pose, lowest)
        copy(refinement.shares, shares)
        state[LOWEST] = judged
        state[SQUARE] = normal[5, 5] * variance / greater(shares[0] - 5.0, 1.0)
        state[DAMPING] *= 0.1
    update_mixture(state[SQUARE], shares, count, matches.min_variance, state[HASTE], mixture)
    mixture[3] = repeated_share(shares[3], count - shares[0])
    _believe(matches, mixture)
    while not solve_five_spd(normal, state[DAMPING], x) and state[DAMPING] < 1e6:
        state[DAMPING] = greater(10.0 * state[DAMPING], 1e-9)
    if not state[DAMPING] < 1e6:
        return False
    state[PROMISED], size2 = promise(normal, x)
    settled = abs(mixture[0] - variance) < greater(0.01, precision) * variance
    if settled and state[PROMISED] < precision:
        return False
    take_step(pose.R, pose.t, x, size2)
    return True


@inner_kernel
def _believe(matches: PackedMatches, mixture: np.ndarray) -> None:
    """No larger noise than is believed."""
    if matches.max_variance < math.inf:
        mixture[0], mixture[2] = lesser(mixture[0], matches.max_variance), NONE


@inner_kernel
def finish(refinement: Refinement) -> None:
    """The likeliest pose is the end; its noise is that of EM one step further."""
    copy(refinement.pose.mixture, refinement.lowest.mixture)
    copy_pose(refinement.lowest, refinement.pose)
