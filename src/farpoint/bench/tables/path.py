"""Errors of paths, compared with their covariances, in recordings or rendered streets."""

from __future__ import annotations

from collections.abc import Iterator

from farpoint.bench.options import BenchOptions, Progress
from farpoint.bench.path_samples import joined, samples_of
from farpoint.bench.sequences import find_sequences
from farpoint.bench.table import Cell, Column, Table
from farpoint.bench.tables.recordings import recordings_table
from farpoint.camera import Camera, KannalaBrandt
from farpoint.metrics import PathConsistency, PathSamples, evaluate_path
from farpoint.odometry import Odometry
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
    """Tables of the recordings in the data, or of rendered streets if there are no recordings."""
    if find_sequences(options.data):
        yield from recordings_table(options, progress)
    else:
        yield from path_table(options, progress)


def path_table(options: BenchOptions, progress: Progress) -> tuple[Table, ...]:
    """A row for each camera; each camera is driven through different rendered streets."""
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
            odometry = Odometry(camera)
            results = list(odometry.run(drive))
            samples.append(
                samples_of(
                    odometry.remaining(),
                    drive.world_from_cam,
                    results,
                    [result.frame0 for result in results],
                )
            )
        progress(f"paths, {name}", _DRIVES, _DRIVES)
        rows.append((name, *_cells(samples)))
    return (
        Table(
            name="path",
            title=f"Paths over rendered streets, {_FPS:g} frames a second: errors over their "
            "sigmas",
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
                "the poses are final poses, as a run writes them",
                "nees: mean over segments of the mean over their poses; 3, 3, 6 and 1 if honest",
                "low, high: 95 % interval of such means, with one sample per segment",
                "lengths_95: share of the lengths of motions within 1.96 of their sigmas",
            ),
        ),
    )


def _cells(drives: list[PathSamples]) -> tuple[Cell, ...]:
    found = evaluate_path(joined(drives))
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
