"""The matches as the kernels take them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

__all__ = ["RayPairs"]


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
