"""The fit of a rotation alone from end to end, and what speaks for a translation beside it."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import kernel
from farpoint._kernels.formulas import formula, greater, lesser
from farpoint._kernels.rotation import explain_rotation, refine_rotation
from farpoint._kernels.scratch import room

__all__ = ["fit_rotation", "flow_beside_rotation"]

# No less of the information is there without knowing which matches are wrong.
LEAST_KNOWN = 0.1


@kernel
def fit_rotation(
    pairs: np.ndarray,
    count: int,
    spread: float,
    min_variance: float,
    max_iterations: int,
    R: np.ndarray,
    mixture: np.ndarray,
    information: np.ndarray,
    distance2: np.ndarray,
    right: np.ndarray,
) -> float:
    """Maximum-likelihood rotation and what it makes of each match; returns its cost.

    As `rotation.refine_rotation` and `rotation.explain_rotation`, all ``count`` matches alike.
    ``information`` (3, 3) receives that of the rotation, less what is not known of the matches, and
    of the noise, as for a motion.
    """
    prior = room(right.size)
    for i in range(right.size):
        prior[i] = 1.0 if i < count else 0.0
    cost = refine_rotation(
        pairs, prior, count, spread, min_variance, max_iterations, R, mixture, information
    )
    known = explain_rotation(pairs, prior, spread, R, mixture, distance2, right)
    supporting = 0.0
    for i in range(right.size):
        supporting += right[i]
    _keep_known(known, supporting, information)
    return cost


@formula
def _keep_known(known: float, supporting: float, information: np.ndarray) -> None:
    freedom = greater(2.0 * supporting - 3.0, 4.0)
    share = greater(known, LEAST_KNOWN) * (freedom - 2.0) / freedom
    for i in range(3):
        for j in range(3):
            information[i, j] *= share


@kernel
def flow_beside_rotation(
    residual: np.ndarray,
    parallax: np.ndarray,
    distance2: np.ndarray,
    right: np.ndarray,
    band: float,
) -> tuple[int, int, float, int, float, float]:
    """How matches lie about their epipolar lines, those that a rotation explains and the others.

    A match agrees with its line within ``band`` of the ``residual`` (N,). ``distance2`` (N,) is the
    square of its distance from where the rotation has it, ``right`` (N,) the probability that this
    one explains it; all for unit noise.

    Returns
    -------
    unexplained, near : int
        Matches that the rotation does not explain; of these, those that agree, flow along their
        line towards the direction and so may be near.
    chance : float
        Sum of the probabilities that the former are near by chance. A wrong match lies anywhere
        around where the rotation has it, at its own distance: this is the arc of that circle, on
        the side of the direction, that the band takes up.
    bulk : int
        Matches that the rotation explains and that agree.
    across, flow : float
        Sums over these of the squares of the residuals and of the distances.
    """
    unexplained = near = bulk = 0
    chance = across = flow = 0.0
    for i in range(residual.size):
        agrees = abs(residual[i]) <= band
        if right[i] < 0.5:
            unexplained += 1
            near += 1 if agrees and parallax[i] > 0.0 else 0
            chance += math.asin(lesser(band / (math.sqrt(distance2[i]) + 1e-300), 1.0)) / math.pi
        elif agrees and right[i] > 0.5:
            bulk += 1
            across += residual[i] * residual[i]
            flow += distance2[i]
    return unexplained, near, chance, bulk, across, flow
