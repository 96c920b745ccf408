"""Errors of the motion of each frame pair against its true motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from farpoint.errors import InputError
from farpoint.geometry import so3, sphere
from farpoint.metrics.statistics import nees
from farpoint.pose import PoseStatus

__all__ = ["PairErrors", "direction_error", "pair_errors", "relative_motions", "rotation_error"]


@dataclass(frozen=True, kw_only=True, eq=False)
class PairErrors:
    """Errors of each pair; NaN for a quantity that is not given, has no truth, or is not counted.

    Perturbations are on the left and in the axes of camera 1, as everywhere in farpoint. An error
    of direction counts if the true translation is at least ``min_translation`` long, because the
    direction of a shorter translation is mostly noise of the truth.

    Attributes
    ----------
    statuses : tuple of PoseStatus
        Status of each of the N pairs.
    true_rotation_angle_rad : ndarray, shape (N,)
        True angle of rotation, rad.
    true_translation : ndarray, shape (N,)
        Length of the true translation, in the unit of the truth; NaN without truth.
    min_translation : float
        Shortest true translation whose direction is compared.
    errors : ndarray, shape (N, 5)
        ``[dtheta (3), dbeta (2)]``, rad: ``R_true = Exp(dtheta) @ R_est``, ``direction_true =
        normalize(direction_est + direction_basis @ dbeta)``. A direction with an error of 90
        degrees or more has an infinite ``dbeta``.
    covariances : ndarray, shape (N, 5, 5)
        Estimated covariances of `errors`, rad^2.
    rotation_angle_rad, direction_angle_rad : ndarray, shape (N,)
        Sizes of the errors, rad.
    rotation_nees, direction_nees, pose_nees : ndarray, shape (N,)
        Normalised squares of the errors, with 3, 2 and 5 degrees of freedom.
    """

    statuses: tuple[PoseStatus, ...]
    true_rotation_angle_rad: np.ndarray
    true_translation: np.ndarray
    min_translation: float
    errors: np.ndarray
    covariances: np.ndarray
    rotation_angle_rad: np.ndarray
    direction_angle_rad: np.ndarray
    rotation_nees: np.ndarray
    direction_nees: np.ndarray
    pose_nees: np.ndarray

    def __len__(self) -> int:
        return len(self.statuses)

    @property
    def has_truth(self) -> np.ndarray:
        """Mask (N,) of the pairs whose true motion is known."""
        return ~np.isnan(self.true_translation)

    @property
    def directions_not_counted(self) -> int:
        """Number of directions that are left out because the true translation is too short."""
        ok = np.array([status is PoseStatus.OK for status in self.statuses], dtype=bool)
        return int(np.count_nonzero(ok & (self.true_translation < self.min_translation)))

    @property
    def directions_opposed(self) -> int:
        """Number of directions with an error of 90 degrees or more."""
        return int(np.count_nonzero(np.isinf(self.errors[:, 3])))


def relative_motions(
    world_from_cam0: np.ndarray, world_from_cam1: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Motions between pairs of poses: rotations (N, 3, 3) and translations (N, 3), cam1_from_cam0.

    Parameters
    ----------
    world_from_cam0, world_from_cam1 : ndarray, shape (N, 4, 4)
        Poses of the cameras; NaN if unknown. The motion is NaN if one of the two poses is NaN.
    """
    R1_transposed = np.swapaxes(world_from_cam1[:, :3, :3], 1, 2)
    rotations = R1_transposed @ world_from_cam0[:, :3, :3]
    offset = world_from_cam0[:, :3, 3] - world_from_cam1[:, :3, 3]
    return rotations, (R1_transposed @ offset[..., None])[..., 0]


def rotation_error(R_est: np.ndarray, R_true: np.ndarray) -> np.ndarray:
    """``dtheta`` (N, 3), rad, of ``R_true = Exp(dtheta) @ R_est``; NaN rows for NaN matrices."""
    residual = R_true @ np.swapaxes(R_est, -1, -2)
    known = np.isfinite(residual).all(axis=(1, 2))
    dtheta = np.full((len(residual), 3), np.nan)
    if known.any():
        dtheta[known] = so3.log(residual[known])
    return dtheta


def direction_error(
    direction_est: np.ndarray, direction_basis: np.ndarray, direction_true: np.ndarray
) -> np.ndarray:
    """``dbeta`` (N, 2), rad, of ``direction_true = normalize(direction_est + basis @ dbeta)``.

    The solution of this definition for ``dbeta`` is the central projection of the true direction on
    the tangent plane, ``basis.T @ direction_true / (direction_est . direction_true)``. The
    projection is infinite for an error of 90 degrees. The result is infinite for larger errors,
    too.

    Parameters
    ----------
    direction_est, direction_true : ndarray, shape (N, 3)
        Unit vectors; NaN rows give NaN.
    direction_basis : ndarray, shape (N, 3, 2)
        Orthonormal tangent bases at ``direction_est``.
    """
    along = np.sum(direction_est * direction_true, axis=1)
    across = np.einsum("nij,ni->nj", direction_basis, direction_true)
    dbeta = np.full_like(across, np.inf)
    np.divide(across, along[:, None], out=dbeta, where=(along > 0.0)[:, None])
    dbeta[np.isnan(along)] = np.nan
    return dbeta


def pair_errors(
    *,
    statuses: Sequence[PoseStatus],
    rotations: np.ndarray,
    directions: np.ndarray,
    covariances: np.ndarray,
    true_rotations: np.ndarray,
    true_translations: np.ndarray,
    min_translation: float = 0.0,
    direction_bases: np.ndarray | None = None,
) -> PairErrors:
    """Compare motions with the truth, pair by pair.

    Parameters
    ----------
    statuses : sequence of PoseStatus, length N
        Status of each pair.
    rotations : ndarray, shape (N, 3, 3)
        ``R_cam1_from_cam0``; NaN where the status is FAILED.
    directions : ndarray, shape (N, 3)
        ``direction_cam1_from_cam0``, unit; NaN unless the status is OK.
    covariances : ndarray, shape (N, 5, 5)
        Covariances of ``[dtheta, dbeta]``, rad^2; NaN for pairs without a covariance. Pairs with
        ROTATION_ONLY or STATIC have the rotation block alone.
    true_rotations : ndarray, shape (N, 3, 3)
        True rotations; NaN if unknown.
    true_translations : ndarray, shape (N, 3)
        True translations, in any unit; NaN if unknown.
    min_translation : float
        Shortest true translation whose direction is compared. A translation of length 0 never
        counts.
    direction_bases : ndarray, shape (N, 3, 2), optional
        Tangent bases to which the covariances refer; by default the bases from `tangent_basis`.

    Raises
    ------
    InputError
        If a shape is wrong, or if a covariance is not positive definite.
    """
    n = len(statuses)
    rotations = _as_shape(rotations, (n, 3, 3), "rotations")
    directions = _as_shape(directions, (n, 3), "directions")
    covariances = _as_shape(covariances, (n, 5, 5), "covariances")
    true_rotations = _as_shape(true_rotations, (n, 3, 3), "true_rotations")
    true_translations = _as_shape(true_translations, (n, 3), "true_translations")
    if direction_bases is None:
        direction_bases = sphere.tangent_basis(directions)
    direction_bases = _as_shape(direction_bases, (n, 3, 2), "direction_bases")

    true_directions = _directions_that_count(true_translations, min_translation)
    dtheta = rotation_error(rotations, true_rotations)
    dbeta = direction_error(directions, direction_bases, true_directions)
    errors = np.hstack([dtheta, dbeta])
    identity = np.broadcast_to(np.eye(3), (n, 3, 3))
    return PairErrors(
        statuses=tuple(statuses),
        true_rotation_angle_rad=np.linalg.norm(rotation_error(identity, true_rotations), axis=1),
        true_translation=np.linalg.norm(true_translations, axis=1),
        min_translation=min_translation,
        errors=errors,
        covariances=covariances,
        rotation_angle_rad=np.linalg.norm(dtheta, axis=1),
        direction_angle_rad=sphere.angle_between(directions, true_directions),
        rotation_nees=nees(dtheta, covariances[:, :3, :3]),
        direction_nees=nees(dbeta, covariances[:, 3:, 3:]),
        pose_nees=nees(errors, covariances),
    )


def _directions_that_count(translations: np.ndarray, min_length: float) -> np.ndarray:
    """Unit vectors (N, 3) of translations that are long enough; NaN for shorter translations."""
    length = np.linalg.norm(translations, axis=1)
    directions = np.full_like(translations, np.nan)
    counted = (length >= min_length) & (length > 0.0)
    directions[counted] = translations[counted] / length[counted, None]
    return directions


def _as_shape(values: np.ndarray, shape: tuple[int, ...], name: str) -> np.ndarray:
    array = np.asarray(values, dtype=np.float64)
    if array.shape != shape:
        raise InputError(f"expected shape {shape}, got {array.shape}", field=name)
    return array
