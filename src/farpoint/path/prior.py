"""Quadratic prior of the unknowns of a window, from marginalised keyframes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from farpoint._kernels.constants import ROUNDING
from farpoint.geometry import so3
from farpoint.path.information import System
from farpoint.path.keyframe import Keyframe
from farpoint.path.residuals import Poses

__all__ = ["Prior", "by_position_change", "rotation_vectors"]


class Prior:
    """Quadratic prior: information and gradient of all unknowns at a fixed linearisation point.

    The unknowns are the poses and the common unknowns: lens and read-out time. The deviation
    ``[theta, rho]`` of a pose from the linearisation point is defined by ``R' = Exp(theta) R`` and
    ``p' = Exp(theta) p + rho``.

    Parameters
    ----------
    common : ndarray, shape (G,)
        Prior mean of lens and read-out time.
    covariance : ndarray, shape (G, G)
        Covariance of ``common``.
    """

    def __init__(self, common: np.ndarray, covariance: np.ndarray) -> None:
        self._common = common
        self._R, self._p = np.empty((0, 3, 3)), np.empty((0, 3))
        self._H, self._g = np.linalg.inv(covariance), np.zeros(len(common))

    def add_pose(self, frame: Keyframe) -> None:
        """Append a pose without prior information."""
        at = [6 * len(self._R)] * 6
        self._H = np.insert(np.insert(self._H, at, 0.0, axis=0), at, 0.0, axis=1)
        self._g = np.insert(self._g, at, 0.0)
        self._R = np.concatenate([self._R, frame.R[None]])
        self._p = np.concatenate([self._p, frame.p[None]])

    def fix_first(self, sigma: float) -> None:
        """Fix the first pose up to errors with the 1-sigma ``sigma``, rad and units of the path."""
        self._H[:6, :6] += np.eye(6) / sigma**2

    def add(self, row: np.ndarray, residual: float, sigma: float, deviation: np.ndarray) -> None:
        """Add a linear measurement at a deviation from the linearisation point.

        ``row`` (D,) holds the derivatives of the ``residual`` by all unknowns, and ``sigma`` is the
        1-sigma of the ``residual``.
        """
        self._H += np.outer(row, row) / sigma**2
        self._g += row * (residual - row @ deviation) / sigma**2

    def deviation(self, poses: Poses, common: np.ndarray) -> np.ndarray:
        """Deviation (D,) of poses and common unknowns from the linearisation point."""
        turns = poses.R @ self._R.transpose(0, 2, 1)
        shifts = poses.p - np.einsum("kij,kj->ki", turns, self._p)
        updated = np.concatenate([rotation_vectors(turns), shifts], axis=1)
        return np.concatenate([updated.ravel(), common - self._common])

    def cost(self, deviation: np.ndarray) -> float:
        """Cost ``g.d + d.H.d / 2`` of a deviation d, up to a constant."""
        return float(self._g @ deviation + 0.5 * deviation @ self._H @ deviation)

    def at(self, deviation: np.ndarray) -> System:
        """Information and gradient at a deviation."""
        return System(self._H, self._g + self._H @ deviation)

    def replace(self, system: System, slot: int, poses: Poses, common: np.ndarray) -> None:
        """Replace the prior by a system of equations in which the pose of ``slot`` is marginalised.

        ``poses`` and ``common`` are the remaining unknowns at the linearisation point of the
        system.
        """
        H, g = system
        out = np.arange(6 * slot, 6 * slot + 6)
        rest = np.delete(np.arange(len(g)), out)
        block = H[np.ix_(out, out)]
        unit = 1.0 / np.sqrt(np.maximum(np.diag(block), 1e-300))
        inverse = np.linalg.pinv(block * np.outer(unit, unit), rcond=ROUNDING, hermitian=True)
        gain = H[np.ix_(rest, out)] @ (inverse * np.outer(unit, unit))
        reduced = H[np.ix_(rest, rest)] - gain @ H[np.ix_(out, rest)]
        self._H, self._g = 0.5 * (reduced + reduced.T), g[rest] - gain @ g[out]
        self._R, self._p = poses.R, poses.p
        self._common = common


def rotation_vectors(R: np.ndarray) -> np.ndarray:
    """Rotation vectors (K, 3) of rotations (K, 3, 3) by less than pi."""
    sines = 0.5 * np.stack(
        [R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1
    )
    sine = np.sqrt(np.sum(sines**2, axis=1))
    angle = np.arctan2(sine, 0.5 * (R[:, 0, 0] + R[:, 1, 1] + R[:, 2, 2] - 1.0))
    return sines * (angle / np.where(sine > 0.0, sine, 1.0) + (sine == 0.0))[:, None]


def by_position_change(
    frames: Sequence[Keyframe], slot0: int, slot1: int, axis: np.ndarray, count: int
) -> np.ndarray:
    """Derivatives (count,) of ``axis . (p1 - p0)`` by all unknowns, for a fixed ``axis`` (3,)."""
    row = np.zeros(count)
    for slot, sign in ((slot1, 1.0), (slot0, -1.0)):
        row[6 * slot : 6 * slot + 3] = sign * (so3.skew(frames[slot].p) @ axis)
        row[6 * slot + 3 : 6 * slot + 6] = sign * axis
    return row
