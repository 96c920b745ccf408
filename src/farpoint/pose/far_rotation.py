"""Rotation from far points by RANSAC on unit rays and refits (Burschka, Mair 2008, eqs. 7-13)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint._kernels.rotation_search import enlarge_rotation, search_rotation
from farpoint.pose.constants import IDENTITY, SEARCH_SAMPLES
from farpoint.pose.matches import Matches

__all__ = ["FarRotation", "far_rotation"]


@dataclass(frozen=True, kw_only=True, eq=False)
class FarRotation:
    """The rotation with which most matches agree, and the matches that agree.

    Attributes
    ----------
    R_cam1_from_cam0 : ndarray, shape (3, 3)
    consistent : ndarray of bool, shape (N,)
        Matches that move by the rotation alone, within the tolerance.
    iterations : int
        Number of samples drawn.
    """

    R_cam1_from_cam0: np.ndarray
    consistent: np.ndarray
    iterations: int


def far_rotation(
    matches: Matches, tolerance: float, state: np.ndarray, max_iterations: int = SEARCH_SAMPLES
) -> FarRotation:
    """Rotation of the far points among ``matches``.

    The rotation minimises the truncated sum of squares
    ``sum min(|b - R a|^2 / variance, tolerance^2)`` over RANSAC samples, and is then refitted to
    the consistent matches. Without far points the result is also such a rotation, although no point
    moves by this rotation alone.

    Parameters
    ----------
    matches : Matches
        At least three matches.
    tolerance : float
        Largest distance ``|b - R a|`` of a consistent match, in units of the standard deviation of
        one coordinate of ``b - R a`` for a noise sigma of 1.
    state : ndarray of uint64, shape (1,)
        Random state, which the function advances.
    max_iterations : int
        Largest number of samples.
    """
    n = len(matches)
    R, consistent = IDENTITY.copy(), np.empty(n, np.bool_)
    iterations = search_rotation(matches.pairs, n, tolerance, max_iterations, state, R)
    enlarge_rotation(matches.pairs, n, tolerance, R, consistent)
    return FarRotation(R_cam1_from_cam0=R, consistent=consistent, iterations=iterations)
