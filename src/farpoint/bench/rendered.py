"""Odometry over rendered images: errors, covariances, and Cramer-Rao bound of the tracks."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from farpoint.bench.table import Cell, Column
from farpoint.geometry import sphere
from farpoint.metrics import chi2_quantile, direction_error, nees, rotation_error
from farpoint.odometry import Odometry, OdometryOptions, OdometryResult
from farpoint.pose import PoseStatus
from farpoint.synthetic import PointScene, RenderedSequence, cramer_rao_bound

__all__ = [
    "RENDERED_COLUMNS",
    "RENDERED_NOTES",
    "RenderedErrors",
    "joined",
    "rendered_cells",
    "run_rendered",
]

RENDERED_COLUMNS = (
    Column("pairs"),
    Column("OK"),
    Column("rotation_median_deg", 4),
    Column("direction_median_deg", 3),
    Column("rotation_over_bound", 2),
    Column("direction_over_bound", 2),
    Column("rotation_95", 3),
    Column("direction_95", 3),
    Column("pose_95", 3),
)
RENDERED_NOTES = (
    "over_bound: errors over the Cramer-Rao bound of the correct tracks, with the noise of their "
    "true errors",
    "95: share of the 95 % regions that contain the truth; rotations of all pairs that are not "
    "FAILED",
)

_RIGHT_PX = 1.0  # tracks with an error above this are outliers
_RIGHT_SIGMA = 5.0  # also tracks with an error above this multiple of the noise


@dataclass(frozen=True, kw_only=True, eq=False)
class RenderedErrors:
    """Errors over P pairs of frames; NaN for a missing estimate.

    For a pair with an estimate of the rotation only, ``rotation_nees`` is the only figure.

    Attributes
    ----------
    statuses : tuple of PoseStatus, length P
    rotation_deg, direction_deg : ndarray, shape (P,)
        Angles between estimate and truth, deg.
    rotation_nees, direction_nees, pose_nees : ndarray, shape (P,)
        Squared errors, normalised by the covariances (NEES).
    rotation_over_bound, direction_over_bound : ndarray, shape (P,)
        Squared errors, normalised by the Cramer-Rao bound of the correct tracks.
    tracks : ndarray of int, shape (P,)
    """

    statuses: tuple[PoseStatus, ...]
    rotation_deg: np.ndarray
    direction_deg: np.ndarray
    rotation_nees: np.ndarray
    direction_nees: np.ndarray
    pose_nees: np.ndarray
    rotation_over_bound: np.ndarray
    direction_over_bound: np.ndarray
    tracks: np.ndarray

    def bound_ratios(self) -> tuple[float, float]:
        """Errors of rotation and direction, relative to the Cramer-Rao bound.

        Each value is the median of the normalised errors, divided by the median of the chi
        distribution. A missing estimate counts as an infinite error.
        """
        rotation, direction = (
            math.sqrt(np.median(np.where(np.isnan(squared), np.inf, squared)) / typical)
            for squared, typical in (
                (self.rotation_over_bound, chi2_quantile(0.5, 3)),
                (self.direction_over_bound, chi2_quantile(0.5, 2)),
            )
        )
        return rotation, direction


_FIGURES = tuple(name for name in RenderedErrors.__annotations__ if name != "statuses")


def run_rendered(
    *sequences: RenderedSequence,
    options: OdometryOptions | None = None,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> RenderedErrors:
    """Run odometry over rendered sequences and compare each pair of frames with the truth.

    The camera must move in every pair.

    Parameters
    ----------
    *sequences : RenderedSequence
        Images with true poses. Odometry starts again with each sequence.
    options : OdometryOptions, optional
    progress : callable
        Called with the number of finished frames and the number of all frames.
    """
    rows, statuses = [], []
    done, total = 0, sum(map(len, sequences))
    for sequence in sequences:
        for result in Odometry(sequence.given, options).run(sequence):
            if result.pose is not None:
                rows.append(_row(sequence, result))
                statuses.append(result.pose.status)
            done += 1
            progress(done, total)
    columns = np.array(rows).T
    return RenderedErrors(statuses=tuple(statuses), **dict(zip(_FIGURES, columns, strict=True)))


def joined(errors: Sequence[RenderedErrors]) -> RenderedErrors:
    """Errors of several runs, joined into one record."""
    return RenderedErrors(
        statuses=tuple(status for one in errors for status in one.statuses),
        **{name: np.concatenate([getattr(one, name) for one in errors]) for name in _FIGURES},
    )


def rendered_cells(errors: RenderedErrors) -> tuple[Cell, ...]:
    """Cells in the order of `RENDERED_COLUMNS`; cells of directions are None without directions."""
    ok = sum(status is PoseStatus.OK for status in errors.statuses)
    rotation_deg, direction_deg = (
        float(np.nanmedian(angles)) if ok else None
        for angles in (errors.rotation_deg, errors.direction_deg)
    )
    return (
        len(errors.statuses),
        ok,
        rotation_deg,
        direction_deg,
        *errors.bound_ratios(),
        _covered(errors.rotation_nees, 3),
        _covered(errors.direction_nees, 2),
        _covered(errors.pose_nees, 5),
    )


def _covered(squares: np.ndarray, dof: int) -> float | None:
    """Share of the 95 % regions that contain the truth; None if no pair has a region."""
    given = squares[~np.isnan(squares)]
    return float(np.mean(given <= chi2_quantile(0.95, dof))) if given.size else None


def _row(sequence: RenderedSequence, result: OdometryResult) -> tuple[float, ...]:
    """The numbers of one pair, in the order of `RenderedErrors`."""
    pose, tracks = result.pose, len(result.tracks)
    assert pose is not None
    R_found, R_covariance = pose.rotation_cam1_from_cam0, pose.rotation_covariance
    if R_found is None or R_covariance is None:
        return (*7 * (math.nan,), tracks)
    motion = sequence.cam1_from_cam0(result.frame0, result.frame1)
    R, direction = motion[None, :3, :3], sphere.normalize(motion[None, :3, 3])
    turn = rotation_error(R_found[None], R)
    turn_nees = float(nees(turn, R_covariance[None])[0])
    found, basis, covariance = pose.direction_cam1_from_cam0, pose.direction_basis, pose.covariance
    if found is None or basis is None or covariance is None:
        return (math.nan, math.nan, turn_nees, *4 * (math.nan,), tracks)
    error = np.concatenate([turn, direction_error(found[None], basis[None], direction)], axis=1)
    bound = cramer_rao_bound(_scene(sequence, result, motion))
    # The bound is in the tangent space of the truth, so truth and estimate are exchanged here.
    off = direction_error(direction, sphere.tangent_basis(direction), found[None])
    return (
        math.degrees(np.linalg.norm(turn)),
        math.degrees(float(sphere.angle_between(found, direction[0]))),
        turn_nees,
        float(nees(error[:, 3:], covariance[None, 3:, 3:])[0]),
        float(nees(error, covariance[None])[0]),
        float(nees(turn, bound[None, :3, :3])[0]),
        float(nees(off, bound[None, 3:, 3:])[0]),
        tracks,
    )


def _scene(sequence: RenderedSequence, result: OdometryResult, motion: np.ndarray) -> PointScene:
    """The tracks as a scene of points with known outliers, distances and noise."""
    tracks = result.tracks
    error_px = tracks.points1 - sequence.transfer(tracks.points0, result.frame0, result.frame1)
    length = np.linalg.norm(error_px, axis=1)
    near = length < _RIGHT_PX  # False for NaN, where the true point is hidden
    sigma = 1.4826 * float(np.median(np.abs(error_px[near])))
    right = length < min(_RIGHT_SIGMA * sigma, _RIGHT_PX)
    return PointScene(
        camera=sequence.camera,
        points0=tracks.points0,
        points1=tracks.points1,
        is_outlier=~right,
        is_far=np.zeros(len(tracks), bool),
        depths=sequence.distances(result.frame0, tracks.points0),
        true_rays0=sequence.camera.unproject(tracks.points0),
        rotation_cam1_from_cam0=motion[:3, :3],
        translation_cam1_from_cam0=motion[:3, 3],
        noise_px=sigma / math.sqrt(2.0),  # the variance of error_px is that of two pixels
    )
