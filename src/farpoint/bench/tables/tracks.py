"""Covariances of what OpenCV tracks, without any noise told, against exact truth."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from farpoint.bench.consistency import CONSISTENCY_COLUMNS, consistency_cells, pose_errors
from farpoint.bench.options import BenchOptions, Progress
from farpoint.bench.plain_script import PlainScript
from farpoint.bench.table import Cell, Column, Table
from farpoint.camera import Camera
from farpoint.pose import PoseStatus, RelativePose, estimate_relative_pose
from farpoint.synthetic import RenderedSequence, street_drive

__all__ = ["tracks_table"]

_PAIRS = 60
_PAIRS_PER_STREET = 3
# Corners, and frames a second.
_CELLS = ((500, 30.0), (500, 10.0), (150, 30.0), (150, 10.0))
_CAMERA = Camera.pinhole(640, 480, 500.0, 500.0, 319.5, 239.5)


def tracks_table(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """A row for each number of corners and rate, as they are filled."""
    rows: list[tuple[Cell, ...]] = []
    for corners, fps in _CELLS:
        rows.append((corners, round(fps), *_figures(corners, fps, options, progress)))
        yield Table(
            name="tracks",
            title="Coverage of estimates from OpenCV's Lucas-Kanade, rendered streets",
            command=options.command("tracks"),
            columns=(
                Column("corners"),
                Column("fps"),
                Column("pairs"),
                Column("tracks"),
                Column("OK"),
                *CONSISTENCY_COLUMNS,
            ),
            rows=tuple(rows),
            notes=(
                "matches as the plain script makes them, and nothing told of their noise; "
                f"{_PAIRS_PER_STREET} pairs in each street, every other one",
                "tracks: median of a pair; the rest as in the table of coverage",
            ),
        )


def _figures(
    corners: int, fps: float, options: BenchOptions, progress: Progress
) -> tuple[Cell, ...]:
    pairs = options.pairs or _PAIRS
    name = f"{corners} corners at {fps:g} frames a second"
    poses: list[RelativePose] = []
    truths, sizes = [], []
    for street in range(math.ceil(pairs / _PAIRS_PER_STREET)):
        progress(name, len(poses), pairs)
        seed = options.seed + street
        path = street_drive(2 * _PAIRS_PER_STREET, fps, seed)
        sequence = RenderedSequence(_CAMERA, path, seed=seed)
        images = [frame.image for frame in sequence if frame.image is not None]
        script = PlainScript(_CAMERA, corners)
        for first in range(0, 2 * _PAIRS_PER_STREET, 2)[: pairs - len(poses)]:
            points0, points1 = script.match(images[first], images[first + 1])
            poses.append(estimate_relative_pose(points0, points1, _CAMERA, seed=options.seed))
            truths.append(sequence.cam1_from_cam0(first, first + 1))
            sizes.append(len(points0))
    progress(name, pairs, pairs)
    truth = np.array(truths)
    return (
        pairs,
        round(float(np.median(sizes))),
        sum(pose.status is PoseStatus.OK for pose in poses),
        *consistency_cells(pose_errors(poses, truth[:, :3, :3], truth[:, :3, 3])),
    )
