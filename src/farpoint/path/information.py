"""Normal equations: solved, and inverted into covariances."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from farpoint._kernels.positive import factorise, invert, solve

__all__ = ["System", "inverse", "solution"]

_RIDGE = 1e-12  # relative, of a diagonal: what rounding makes of zero


class System(NamedTuple):
    """Information (D, D) and gradient (D,) of the unknowns."""

    H: np.ndarray
    g: np.ndarray


def solution(system: System, damping: float) -> np.ndarray:
    """Step (D,) of a system whose diagonal is damped by a share; zero where there is none."""
    unit, factor = np.empty(len(system.g)), np.empty_like(system.H)
    step = np.zeros(len(system.g))
    if factorise(system.H, damping, unit, factor):
        solve(factor, unit, -system.g, step)
    return step


def inverse(H: np.ndarray) -> np.ndarray:
    """Of an information matrix whose diagonal spans many orders."""
    unit, factor, found = np.empty(len(H)), np.empty_like(H), np.empty_like(H)
    if factorise(H, _RIDGE, unit, factor):
        invert(factor, unit, np.empty_like(H), found)
        return found
    scaled = np.nan_to_num(H * np.outer(unit, unit))
    return np.linalg.pinv(scaled, hermitian=True) * np.outer(unit, unit)
