"""Whether paths are as sure as they say: over recordings, or rendered streets drive by drive."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from farpoint.bench.options import BenchOptions, Progress
from farpoint.bench.sequences import find_sequences
from farpoint.bench.table import Cell, Column, Table
from farpoint.bench.tables.recordings import recordings_table
from farpoint.camera import Camera, KannalaBrandt
from farpoint.metrics import PathConsistency, PathSamples, evaluate_path
from farpoint.odometry import Odometry, OdometryResult
from farpoint.synthetic import RenderedSequence, street_drive

__all__ = ["path_table", "path_tables"]

_DRIVES = 8  # a drive is one sample: its errors add up from pose to pose
_MOTIONS = 100
_FPS = 10.0

# Small images, which render fast: their tracks are noisier, and few.
_CAMERAS: tuple[tuple[str, Camera], ...] = (
    ("pinhole, 72 deg", Camera.pinhole(320, 240, 220.0, 220.0, 159.5, 119.5)),
    (
        "fisheye, 180 deg",
        Camera(
            model=KannalaBrandt(fx=120.0, fy=120.0, cx=191.5, cy=127.5, k1=3e-3, k2=5e-4),
            size=(384, 256),
        ),
    ),
)


def path_tables(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """Of the recordings of the data, or of rendered streets where it holds none."""
    if find_sequences(options.data):
        yield from recordings_table(options, progress)
    else:
        yield from path_table(options, progress)


def path_table(options: BenchOptions, progress: Progress) -> tuple[Table, ...]:
    """A row for each camera, driven through streets of its own."""
    motions = options.pairs or _MOTIONS
    rows = []
    for k, (name, camera) in enumerate(_CAMERAS):
        first = options.seed + k * _DRIVES
        drives = (
            RenderedSequence(camera, street_drive(motions + 1, _FPS, seed), seed=seed)
            for seed in range(first, first + _DRIVES)
        )
        samples = []
        for done, drive in enumerate(drives):
            progress(f"paths, {name}", done, _DRIVES)
            results = list(Odometry(camera).run(drive))
            samples.append(_samples(results, drive.world_from_cam))
        progress(f"paths, {name}", _DRIVES, _DRIVES)
        rows.append((name, *_cells(samples)))
    return (
        Table(
            name="path",
            title=f"Paths over rendered streets, {_FPS:g} frames a second: as sure as they say?",
            command=options.command("path"),
            columns=(
                Column("lens"),
                Column("drives"),
                Column("segments"),
                Column("motions"),
                Column("orientation_nees", 2),
                Column("position_nees", 2),
                Column("pose_nees", 2),
                Column("pose_low", 2),
                Column("pose_high", 2),
                Column("scale_nees", 2),
                Column("scale_low", 2),
                Column("scale_high", 2),
                Column("lengths_95", 2),
            ),
            rows=tuple(rows),
            notes=(
                "nees: mean over segments of the mean over their poses; 3, 3, 6 and 1 if honest",
                "low, high: where 95 % of such means lie, of one sample for each segment",
                "lengths_95: share of the lengths of motions within 1.96 of their sigmas",
            ),
        ),
    )


def _samples(results: list[OdometryResult], truth: np.ndarray) -> PathSamples:
    nan = float("nan")
    return PathSamples(
        segments=np.array([result.segment for result in results]),
        world_from_cam=np.array([result.world_from_cam for result in results]),
        covariances=np.array([result.world_covariance for result in results]),
        truth=truth,
        lengths=np.array([nan if r.scale is None else r.scale for r in results]),
        length_sigmas=np.array([nan if r.scale_sigma is None else r.scale_sigma for r in results]),
        length_from=np.array([result.frame0 for result in results]),
    )


def _joined(drives: list[PathSamples]) -> PathSamples:
    """Several drives as segments of one path."""
    counts = [len(drive.segments) for drive in drives]
    rows = np.cumsum([0, *counts[:-1]])
    numbers = np.cumsum([0, *(int(drive.segments[-1]) + 1 for drive in drives[:-1])])
    same = ("world_from_cam", "covariances", "truth", "lengths", "length_sigmas")
    return PathSamples(
        segments=np.concatenate([d.segments + n for d, n in zip(drives, numbers, strict=True)]),
        length_from=np.concatenate([d.length_from + n for d, n in zip(drives, rows, strict=True)]),
        **{name: np.concatenate([getattr(drive, name) for drive in drives]) for name in same},
    )


def _cells(drives: list[PathSamples]) -> tuple[Cell, ...]:
    found = evaluate_path(_joined(drives))
    assert found is not None  # the drives move
    return (len(drives), *_figures(found))


def _figures(found: PathConsistency) -> tuple[Cell, ...]:
    return (
        found.pose.segments,
        found.scale.poses,
        found.orientation.mean_nees,
        found.position.mean_nees,
        found.pose.mean_nees,
        found.pose.nees_low,
        found.pose.nees_high,
        found.scale.mean_nees,
        found.scale.nees_low,
        found.scale.nees_high,
        found.lengths.coverage95.share,
    )
