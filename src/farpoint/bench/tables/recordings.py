"""Paths over real recordings with true poses: errors, sigmas, and time."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from farpoint.bench.interleaved import one_thread
from farpoint.bench.options import BenchOptions, Progress
from farpoint.bench.path_samples import samples_of
from farpoint.bench.sequences import Recording, find_sequences, recorded
from farpoint.bench.table import Cell, Column, Table
from farpoint.metrics import (
    STRETCH_SHARES,
    PathSamples,
    StretchFigure,
    evaluate_stretches,
    path_length,
    scale_drift,
    sim3_misfit,
)
from farpoint.odometry import Odometry, OdometryResult
from farpoint.path.point import FinalPose

__all__ = ["recordings_table"]

_WARM_UP = 5  # frames whose time does not count: loading, compiling
_COLUMNS = (
    Column("sequence"),
    Column("frames"),
    Column("path_m", 2),
    Column("ate_m", 4),
    Column("drift_percent", 1),
    *(Column(f"lengths_{100.0 * share:g}", 2) for share in STRETCH_SHARES),
    *(Column(f"rotations_{100.0 * share:g}", 2) for share in STRETCH_SHARES),
    Column("focal_given_px", 1),
    Column("focal_px", 1),
    Column("focal_sigma_px", 1),
    Column("breaks"),
    Column("guesses"),
    Column("path_ms", 2),
)


def recordings_table(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """A row for each image sequence with true poses, and a row for all sequences together."""
    rows: list[tuple[Cell, ...]] = []
    stretches: list[tuple[StretchFigure, ...]] = []
    for sequence in find_sequences(options.data):
        recording = recorded(sequence)
        if recording is None:
            continue
        run = _run(recording, options, lambda k, of, name=sequence.name: progress(name, k, of))
        stretches.append(run.stretches)
        rows.append((sequence.name, *run.cells()))
        yield _table([*rows, _together(stretches)], options)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Run:
    """Result for a recording with N frames and P final poses, including the true poses."""

    results: list[OdometryResult]
    samples: PathSamples
    stretches: tuple[StretchFigure, ...]
    focal: tuple[Cell, Cell, Cell]
    path_s: float

    def cells(self) -> tuple[Cell, ...]:
        """Cells of the recording's row, without the first cell (the name)."""
        known = np.isfinite(self.samples.truth[:, 0, 0])
        found, truth = self.samples.world_from_cam[known], self.samples.truth[known]
        length, ate, drift = path_length(truth), math.nan, math.nan
        if length > 0.0:
            ate = sim3_misfit(found[:, :3, 3], truth[:, :3, 3])
            drift = 100.0 * scale_drift(found, truth)
        return (
            len(self.results),
            length or None,
            ate,
            drift,
            *_shares(self.stretches),
            *self.focal,
            self.results[-1].segment,
            sum(result.scale_is_guessed for result in self.results),
            1e3 * self.path_s,
        )


def _run(recording: Recording, options: BenchOptions, progress: Callable[[int, int], None]) -> _Run:
    odometry = Odometry(recording.camera)
    frames = recording.frames[: options.pairs + 1 if options.pairs else None]
    results: list[OdometryResult] = []
    poses: list[FinalPose] = []
    cpu_s, before = 0.0, dict(odometry.seconds)
    with one_thread():
        for k, frame in enumerate(frames):
            if k == _WARM_UP:
                cpu_s, before = 0.0, dict(odometry.seconds)
            start = time.process_time()
            results.append(odometry.process(frame.image, frame.timestamp, fault=frame.fault))
            poses += odometry.final_poses()
            cpu_s += time.process_time() - start
            progress(k + 1, len(frames))
    poses += odometry.remaining()
    # The path is timed with the wall clock. Its CPU time is taken as the CPU time of a frame, times
    # the share of the path in the wall-clock time.
    spent = {name: odometry.seconds[name] - before[name] for name in before}
    share = spent["path"] / max(sum(spent.values()), 1e-9)
    samples = samples_of(poses, recording.world_from_cam)
    return _Run(
        results=results,
        samples=samples,
        stretches=evaluate_stretches(samples),
        focal=_focal(odometry),
        path_s=share * cpu_s / max(len(frames) - _WARM_UP, 1),
    )


def _focal(odometry: Odometry) -> tuple[Cell, Cell, Cell]:
    """Given focal length, estimated focal length and sigma of the estimate, px."""
    lens = odometry.lens
    given, found = (camera.model.parameters["fx"] for camera in (lens.given, lens.camera))
    return given, found, lens.sigma.get("fx")


def _shares(figures: Sequence[StretchFigure]) -> tuple[Cell, ...]:
    if not figures:
        return (None,) * (2 * len(STRETCH_SHARES))
    return (*(f.lengths.share for f in figures), *(f.rotations.share for f in figures))


def _together(runs: Sequence[tuple[StretchFigure, ...]]) -> tuple[Cell, ...]:
    """Cells of the row for the stretches of all recordings together."""
    shares: list[Cell] = []
    for kind in ("lengths", "rotations"):
        for k in range(len(STRETCH_SHARES)):
            found = [getattr(run[k], kind) for run in runs if run]
            count = sum(coverage.count for coverage in found)
            inside = sum(coverage.inside for coverage in found)
            shares.append(inside / count if count else None)
    return ("all together", *(None,) * 4, *shares, *(None,) * 6)


def _table(rows: Sequence[tuple[Cell, ...]], options: BenchOptions) -> Table:
    return Table(
        name="recordings",
        title="Paths over real recordings: errors, sigmas and time",
        command=options.command("path"),
        columns=_COLUMNS,
        rows=tuple(rows),
        notes=(
            "ate: root mean square distance of the final poses after the best similarity "
            "transform (Sim(3)); drift: scale of the last 20 % of the path over that of the "
            "first 20 %, minus 1",
            "lengths_n, rotations_n: share of stretches of n % of the path whose length (with "
            "one scale for all) or rotation lies within its 95 % region; if the truth has no "
            "positions, stretches are n % of the poses",
            "focal: focal length along x, given by the calibration and estimated, with its sigma",
            "breaks: new segments; guesses: lengths extrapolated from the last speed",
            "path_ms: processor time of the path per frame, with keyframes, without the first "
            f"{_WARM_UP} frames: the processor time of the frame, times the share of the path in "
            "its wall-clock time",
        ),
    )
