"""The matches as the kernels take them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from farpoint._kernels.compile import inner_kernel

__all__ = ["RayPairs", "flow_variance"]


class RayPairs(NamedTuple):
    """N pairs of unit rays with the noise factor of each; C-ordered float64.

    A ray is known up to ``noise @ n`` with ``n ~ N(0, sigma^2 I)``.
    """

    rays0: np.ndarray
    """(N, 3) unit rays in camera 0."""
    rays1: np.ndarray
    """(N, 3) unit rays in camera 1."""
    noise0: np.ndarray
    """(N, 3, 2) noise factors of ``rays0``, perpendicular to them."""
    noise1: np.ndarray
    """(N, 3, 2) noise factors of ``rays1``, perpendicular to them."""


@inner_kernel
def flow_variance(pairs: RayPairs, i: int) -> float:
    """Variance, rad^2 for unit noise, of the flow of match ``i`` in one direction, on average."""
    squares = 0.0
    for k in range(3):
        for c in range(2):
            squares += pairs.noise0[i, k, c] ** 2 + pairs.noise1[i, k, c] ** 2
    return 0.5 * squares
