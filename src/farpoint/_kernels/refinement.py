"""Maximum-likelihood refinement of a pose: Gauss-Newton alternating with EM of the noise."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inner_kernel, step_kernel
from farpoint._kernels.constants import (
    KEPT_COST,
    KEPT_MIXTURE,
    KEPT_NORMAL,
    KEPT_SHARES,
    KEPT_SIZE,
    KEPT_T,
    MAX_COST_INCREASE,
    NO_TAIL_SHARE,
    STATE_DAMPING,
    STATE_LOWEST,
    STATE_OVER_RELAXED,
    STATE_PREDICTED_DECREASE,
    STATE_SQUARE,
)
from farpoint._kernels.likelihood import linearize
from farpoint._kernels.mixture import mixture_cost, repeated_share, share_prior_cost, update_mixture
from farpoint._kernels.normal_equations import predicted_decrease, solve_five_spd
from farpoint._kernels.pose import (
    LinearisationPoint,
    PackedMatches,
    Pose,
    linearisation_point,
    take_step,
)

__all__ = ["advance", "begin", "finish", "refine_pose"]


@inner_kernel
def refine_pose(matches: PackedMatches, precision: float, max_iterations: int, pose: Pose) -> None:
    """Maximum-likelihood pose, with noise parameters by EM.

    The method is Gauss-Newton with the full derivative of the residuals and with soft cheirality.
    ``pose`` holds the initial pose and mixture, and receives the refined pose with normal equations
    and cost. The refinement ends if the predicted decrease is below ``precision``, in log
    likelihood, and the variance has converged.
    """
    normal, cost, shares = pose.normal, pose.cost, np.empty(4)
    point = linearisation_point(matches, pose.R, pose.t, pose.mixture)
    state, kept = np.empty(5), np.empty(KEPT_SIZE)
    begin(matches, point.mixture, state)
    for _ in range(max_iterations):
        if not advance(matches, point, precision, normal, cost, shares, state, kept):
            break
    finish(point.R, point.t, point.mixture, normal, cost, shares, kept)


@step_kernel
def begin(matches: PackedMatches, mixture: np.ndarray, state: np.ndarray) -> None:
    """Initialise the state, and bound the noise of the initial mixture."""
    bound_noise(matches.max_variance, mixture)
    state[STATE_LOWEST] = state[STATE_SQUARE] = math.inf
    state[STATE_DAMPING], state[STATE_OVER_RELAXED], state[STATE_PREDICTED_DECREASE] = 0.0, 1.0, 0.0


@step_kernel
def advance(
    matches: PackedMatches,
    point: LinearisationPoint,
    precision: float,
    normal: np.ndarray,
    cost: np.ndarray,
    shares: np.ndarray,
    state: np.ndarray,
    kept: np.ndarray,
) -> bool:
    """Evaluate the pose and take a step; False at convergence.

    ``point`` is updated in place; ``normal`` and ``cost`` are those before the step. ``kept`` (57,)
    holds the likeliest pose, ``state`` (5,) the state between steps. If the pose has a cost that is
    more than `MAX_COST_INCREASE` above the lowest cost so far, the previous step is taken back.
    """
    R, t, mixture = point.R, point.t, point.mixture
    variance = mixture[0]
    cost[0] = linearize(point, matches.soft_cheirality, normal, shares)
    cost[0] += matches.total * mixture_cost(variance, mixture[1])
    penalised_cost = cost[0] + share_prior_cost(mixture[2]) + share_prior_cost(mixture[3])
    if penalised_cost > state[STATE_LOWEST] + MAX_COST_INCREASE:
        restore(kept, R, t, mixture, normal, cost, shares)
        # The first step that is taken back switches off over-relaxation. Each later step that is
        # taken back increases the damping.
        if state[STATE_OVER_RELAXED] == 0.0:
            state[STATE_DAMPING] = max(100.0 * state[STATE_DAMPING], 1e-2)
        state[STATE_OVER_RELAXED] = 0.0
    else:
        keep(R, t, mixture, normal, cost, shares, kept)
        state[STATE_LOWEST] = penalised_cost
        state[STATE_SQUARE] = normal[5, 5] * variance / max(shares[0] - 5.0, 1.0)
        state[STATE_DAMPING] *= 0.1
    return _take_step(matches, precision, variance, R, t, mixture, normal, shares, state)


@inner_kernel
def _take_step(
    matches: PackedMatches,
    precision: float,
    variance: float,
    R: np.ndarray,
    t: np.ndarray,
    mixture: np.ndarray,
    normal: np.ndarray,
    shares: np.ndarray,
    state: np.ndarray,
) -> bool:
    """One step of EM and one step of Gauss-Newton from the likeliest pose; False at convergence."""
    x, count = np.empty(5), float(matches.total)
    update_mixture(
        state[STATE_SQUARE], shares, count, matches.min_variance, state[STATE_OVER_RELAXED], mixture
    )
    mixture[3] = repeated_share(shares[3], count - shares[0])
    bound_noise(matches.max_variance, mixture)
    while not solve_five_spd(normal, state[STATE_DAMPING], x) and state[STATE_DAMPING] < 1e6:
        state[STATE_DAMPING] = max(10.0 * state[STATE_DAMPING], 1e-9)
    if not state[STATE_DAMPING] < 1e6:
        return False
    state[STATE_PREDICTED_DECREASE], size2 = predicted_decrease(normal, x)
    has_converged = abs(mixture[0] - variance) < max(0.01, precision) * variance
    if has_converged and state[STATE_PREDICTED_DECREASE] < precision:
        return False
    take_step(R, t, x, size2)
    return True


@step_kernel
def bound_noise(max_variance: float, mixture: np.ndarray) -> None:
    """Bound the noise variance of the mixture; a finite bound also removes the tail."""
    if max_variance < math.inf:
        mixture[0], mixture[2] = min(mixture[0], max_variance), NO_TAIL_SHARE


@step_kernel
def finish(
    R: np.ndarray,
    t: np.ndarray,
    mixture: np.ndarray,
    normal: np.ndarray,
    cost: np.ndarray,
    shares: np.ndarray,
    kept: np.ndarray,
) -> None:
    """Restore the likeliest pose, with the mixture of one more EM step."""
    for k in range(4):
        kept[KEPT_MIXTURE + k] = mixture[k]
    restore(kept, R, t, mixture, normal, cost, shares)


@inner_kernel
def keep(
    R: np.ndarray,
    t: np.ndarray,
    mixture: np.ndarray,
    normal: np.ndarray,
    cost: np.ndarray,
    shares: np.ndarray,
    kept: np.ndarray,
) -> None:
    """Keep a pose as the likeliest one."""
    for i in range(3):
        kept[KEPT_T + i] = t[i]
        for j in range(3):
            kept[3 * i + j] = R[i, j]
    for i in range(6):
        for j in range(6):
            kept[KEPT_NORMAL + 6 * i + j] = normal[i, j]
    for k in range(4):
        kept[KEPT_MIXTURE + k] = mixture[k]
        kept[KEPT_SHARES + k] = shares[k]
    kept[KEPT_COST] = cost[0]


@inner_kernel
def restore(
    kept: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    mixture: np.ndarray,
    normal: np.ndarray,
    cost: np.ndarray,
    shares: np.ndarray,
) -> None:
    """Restore the pose that `keep` has stored."""
    for i in range(3):
        t[i] = kept[KEPT_T + i]
        for j in range(3):
            R[i, j] = kept[3 * i + j]
    for i in range(6):
        for j in range(6):
            normal[i, j] = kept[KEPT_NORMAL + 6 * i + j]
    for k in range(4):
        mixture[k] = kept[KEPT_MIXTURE + k]
        shares[k] = kept[KEPT_SHARES + k]
    cost[0] = kept[KEPT_COST]
