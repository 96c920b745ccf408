"""Solution and inversion of normal equations."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from farpoint._kernels.constants import ROUNDING
from farpoint.path.kernels.cholesky import factorise, invert, solve

__all__ = ["System", "inverse", "solution"]


class System(NamedTuple):
    """Information (D, D) and gradient (D,) of the unknowns."""

    H: np.ndarray
    g: np.ndarray


def solution(system: System, damping: float) -> np.ndarray:
    """Levenberg-Marquardt step (D,) with relative damping; zero if the system is singular."""
    unit, factor = np.empty(len(system.g)), np.empty_like(system.H)
    step = np.zeros(len(system.g))
    if factorise(system.H, damping, unit, factor):
        solve(factor, unit, -system.g, step)
    return step


def inverse(H: np.ndarray) -> np.ndarray:
    """Covariance: inverse of an information matrix.

    The matrix is scaled to a unit diagonal before the inversion. Eigenvalues of the scaled matrix
    that are zero, or negative due to rounding, are replaced by a lower bound: the variance along
    such an eigenvector is large but finite.
    """
    unit, factor, found = np.empty(len(H)), np.empty_like(H), np.empty_like(H)
    if factorise(H, ROUNDING, unit, factor):
        invert(factor, unit, np.empty_like(H), found)
        return found
    eigenvalues, axes = np.linalg.eigh(np.nan_to_num(H * np.outer(unit, unit)))
    least = ROUNDING * max(float(eigenvalues[-1]), 1.0)
    return (axes / np.maximum(eigenvalues, least)) @ axes.T * np.outer(unit, unit)
