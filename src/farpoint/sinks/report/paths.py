"""The path from above, as a bounded number of points."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from farpoint.errors import InputError
from farpoint.metrics import align_sim3, poses_at_frames, poses_at_times
from farpoint.sinks.positions import iter_positions
from farpoint.sinks.report.digest import count_lines
from farpoint.trajectory.files import iter_tum, read_trajectory

__all__ = ["Paths", "paths_from_above"]

_MAX_POINTS = 2000


@dataclass(frozen=True, kw_only=True, eq=False)
class Paths:
    """The path from above: x to the right of the first camera, z forward.

    Attributes
    ----------
    time_s : ndarray, shape (P,)
        Seconds since the first frame.
    x_z : ndarray, shape (P, 2)
        Positions in the unit of the files: metres, or the unit of the trajectory.
    segments : ndarray of int, shape (P,)
        Index of the segment of the path for each position. Between segments the scale was lost.
    covariance : ndarray, shape (P, 2, 2)
        Covariance of each position relative to the start of the segment, squared units; NaN where
        unknown.
    true_x_z : ndarray, shape (P, 2), or None
        True positions at the same times after Sim(3) alignment with the path. NaN where a true
        position is missing; None without any true positions.
    """

    time_s: np.ndarray
    x_z: np.ndarray
    segments: np.ndarray
    covariance: np.ndarray
    true_x_z: np.ndarray | None = None

    @property
    def lengths(self) -> np.ndarray:
        """Lengths of the steps within segments, from point to point."""
        steps = np.linalg.norm(np.diff(self.x_z, axis=0), axis=1)
        return steps[np.diff(self.segments) == 0]


def paths_from_above(folder: Path, truth: Path | None = None) -> Paths:
    """The path in a run's folder, and the true path if given.

    Raises
    ------
    InputError
        If a file cannot be read, or if the path and the true path have no time or frame in common.
    """
    table = np.array([_cells(*row) for row in _thinned(folder)]).reshape(-1, 10)
    stamps, frames, segments, places = table[:, 0], table[:, 1], table[:, 2], table[:, 3:6]
    true_places = None
    if truth is not None and len(table):
        true_places = _true_places(truth, stamps, frames.astype(np.int64), places)
    return Paths(
        time_s=stamps - stamps[0] if len(stamps) else stamps,
        x_z=places[:, [0, 2]],
        segments=segments.astype(np.int64),
        covariance=table[:, 6:].reshape(-1, 2, 2),
        true_x_z=None if true_places is None else true_places[:, [0, 2]],
    )


_Row = tuple[float, int, int, np.ndarray, np.ndarray]


def _cells(
    stamp: float, frame: int, segment: int, place: np.ndarray, covariance: np.ndarray
) -> list[float]:
    return [stamp, frame, segment, *place, *covariance.ravel()]


def _thinned(folder: Path) -> Iterator[_Row]:
    """Every k-th frame, at most `_MAX_POINTS` frames, and the last frame."""
    path = folder / "positions.csv"
    rows = _from_positions(path) if path.is_file() else _from_tum(folder / "trajectory.tum")
    path = path if path.is_file() else folder / "trajectory.tum"
    stride = max(1, -(-count_lines(path) // _MAX_POINTS))
    row: _Row | None = None
    count = 0
    for count, row in enumerate(rows):
        if count % stride == 0:
            yield row
    if row is not None and count % stride:
        yield row


def _from_positions(path: Path) -> Iterator[_Row]:
    for part in iter_positions(path):
        flat = part.covariances[:, [3, 5]][:, :, [3, 5]]
        yield from zip(
            part.timestamps, part.frames, part.segments, part.positions, flat, strict=True
        )


def _from_tum(path: Path) -> Iterator[_Row]:
    """Rows of a ``trajectory.tum``; covariances are unknown."""
    unknown = np.full((2, 2), np.nan)
    for frame, (stamp, pose) in enumerate(iter_tum(path, whole_lines=True)):
        yield stamp, frame, 0, pose[:3, 3], unknown


def _true_places(
    truth: Path, stamps: np.ndarray, frames: np.ndarray, places: np.ndarray
) -> np.ndarray | None:
    """True positions (P, 3) in the axes of the estimate; None if an alignment is not possible."""
    reference = read_trajectory(truth)
    if reference.timestamps is None:
        poses = poses_at_frames(reference.world_from_body, frames)
    else:
        poses = poses_at_times(reference.timestamps, reference.world_from_body, stamps)
    true_places = poses[:, :3, 3]
    known = np.isfinite(true_places[:, 0])
    try:
        fit = align_sim3(true_places[known], places[known])
    except InputError:  # a camera that stood still fits anywhere
        return None
    return fit.scale * true_places @ fit.rotation.T + fit.translation
