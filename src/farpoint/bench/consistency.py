"""Errors of many poses, compared with their covariances, as cells of a table."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from farpoint.bench.table import Cell, Column
from farpoint.metrics import Consistency, PairErrors, consistency, pair_errors
from farpoint.pose import RelativePose

__all__ = ["CONSISTENCY_COLUMNS", "consistency_cells", "coverage_cells", "pose_errors"]

CONSISTENCY_COLUMNS = tuple(
    column
    for name in ("pose", "rotation")
    for column in (
        Column(f"{name}_68", 3),
        Column(f"{name}_95", 3),
        Column(f"{name}_95_low", 3),
        Column(f"{name}_95_high", 3),
        Column(f"{name}_nees", 1),
        Column(f"{name}_sigma_over_error", 2),
    )
)


def pose_errors(
    poses: Sequence[RelativePose], true_rotations: np.ndarray, true_translations: np.ndarray
) -> PairErrors:
    """Errors and covariances of P poses; the true motions have shapes (P, 3, 3) and (P, 3)."""
    return pair_errors(
        statuses=[pose.status for pose in poses],
        rotations=np.array([_or_nan(p.rotation_cam1_from_cam0, 3, 3) for p in poses]),
        directions=np.array([_or_nan(p.direction_cam1_from_cam0, 3) for p in poses]),
        direction_bases=np.array([_or_nan(p.direction_basis, 3, 2) for p in poses]),
        covariances=np.array([_covariance(pose) for pose in poses]),
        true_rotations=true_rotations,
        true_translations=true_translations,
    )


def consistency_cells(errors: PairErrors) -> tuple[Cell, ...]:
    """Cells of a row, in the order of `CONSISTENCY_COLUMNS`."""
    pose = consistency(errors.errors, errors.covariances)
    rotation = consistency(errors.errors[:, :3], errors.covariances[:, :3, :3])
    return (*_cells(pose), *_cells(rotation))


def coverage_cells(found: Consistency) -> tuple[Cell, ...]:
    """Share of the 95 % regions that contain the truth, and 95 % interval of this share."""
    if not found.count:
        return None, None, None
    return found.coverage95.share, found.coverage95.low, found.coverage95.high


def _or_nan(values: np.ndarray | None, *shape: int) -> np.ndarray:
    return np.full(shape, np.nan) if values is None else values


def _covariance(pose: RelativePose) -> np.ndarray:
    covariance = np.full((5, 5), np.nan)
    if pose.covariance is not None:
        return pose.covariance
    if pose.rotation_covariance is not None:
        covariance[:3, :3] = pose.rotation_covariance
    return covariance


def _cells(found: Consistency) -> tuple[Cell, ...]:
    if not found.count:
        return (None,) * 6
    return (
        found.coverage68.share,
        found.coverage95.share,
        found.coverage95.low,
        found.coverage95.high,
        found.mean_nees,
        found.sigma_over_error,
    )
