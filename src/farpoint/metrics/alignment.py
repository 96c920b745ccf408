"""Alignment of one trajectory with another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint.errors import InputError

__all__ = ["Similarity", "align_se3", "align_sim3", "sim3_misfit"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Similarity:
    """A similarity transform of points, ``x -> scale * rotation @ x + translation``.

    Attributes
    ----------
    scale : float
        Positive; 1 for a rigid motion.
    rotation : ndarray, shape (3, 3)
        Proper rotation.
    translation : ndarray, shape (3,)
        Lengths in the unit of the target.
    """

    scale: float
    rotation: np.ndarray
    translation: np.ndarray

    def apply_to_poses(self, world_from_cam: np.ndarray) -> np.ndarray:
        """Transformed poses (N, 4, 4): positions transformed, orientations rotated."""
        moved = np.array(world_from_cam, dtype=np.float64)
        moved[:, :3, :3] = self.rotation @ moved[:, :3, :3]
        moved[:, :3, 3] = self.scale * moved[:, :3, 3] @ self.rotation.T + self.translation
        return moved


def align_sim3(source: np.ndarray, target: np.ndarray) -> Similarity:
    """Similarity that maps points ``source`` (N, 3) to ``target`` (N, 3) by least squares.

    The closed form is that of Umeyama, "Least-Squares Estimation of Transformation Parameters
    Between Two Point Patterns", PAMI 13(4), 1991, doi:10.1109/34.88573, eqs. 40-42.

    Raises
    ------
    InputError
        If shapes differ, or if the points lie on one line, so that the best rotation is not unique.
    """
    rotation, singular, variance = _umeyama(source, target)
    return _completed(singular / variance, rotation, source, target)


def align_se3(source: np.ndarray, target: np.ndarray) -> Similarity:
    """Rigid motion that maps ``source`` (N, 3) to ``target`` by least squares; see `align_sim3`."""
    rotation, _, _ = _umeyama(source, target)
    return _completed(1.0, rotation, source, target)


def sim3_misfit(source: np.ndarray, target: np.ndarray) -> float:
    """Root mean square distance of ``source`` (N, 3) from ``target`` after `align_sim3`: the ATE.

    The points may lie on one line, because the misfit is the same for every rotation about this
    line (Umeyama 1991, eq. 33).
    """
    x, y = source - source.mean(axis=0), target - target.mean(axis=0)
    U, D, Vt = np.linalg.svd(y.T @ x / len(x))
    S = np.array([1.0, 1.0, np.sign(np.linalg.det(U) * np.linalg.det(Vt))])
    variance, true_variance = (float(np.mean(np.sum(z**2, axis=1))) for z in (x, y))
    fitted = float(D @ S) ** 2 / variance if variance > 0.0 else 0.0
    return float(np.sqrt(max(true_variance - fitted, 0.0)))


def _umeyama(source: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Rotation, signed sum of singular values ``tr(D S)``, and variance of the source points."""
    if source.shape != target.shape or source.ndim != 2 or source.shape[1] != 3:
        raise InputError(
            f"expected two arrays of shape (N, 3), got {source.shape} and {target.shape}",
            field="source, target",
        )
    if len(source) < 3:
        raise InputError(f"expected at least 3 positions, got {len(source)}", field="source")
    x, y = source - source.mean(axis=0), target - target.mean(axis=0)
    U, D, Vt = np.linalg.svd(y.T @ x / len(x))
    # The second singular value must exceed rounding errors; otherwise the points lie on a line, and
    # the rotation about this line is arbitrary.
    if not D[1] > 1e-12 * max(D[0], np.finfo(float).tiny):
        raise InputError("positions lie on one line: no unique alignment", field="source, target")
    S = np.array([1.0, 1.0, np.sign(np.linalg.det(U) * np.linalg.det(Vt))])
    return (U * S) @ Vt, float(D @ S), float(np.mean(np.sum(x**2, axis=1)))


def _completed(
    scale: float, rotation: np.ndarray, source: np.ndarray, target: np.ndarray
) -> Similarity:
    translation = target.mean(axis=0) - scale * rotation @ source.mean(axis=0)
    return Similarity(scale=scale, rotation=rotation, translation=translation)
