"""Coverage of odometry over rendered streets, for motions of a car, a hand or a drone."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial

import numpy as np

from farpoint.bench.cameras import FISHEYE, PINHOLE
from farpoint.bench.options import BenchOptions, Progress
from farpoint.bench.rendered import (
    RENDERED_COLUMNS,
    RENDERED_NOTES,
    rendered_cells,
    run_rendered,
)
from farpoint.bench.sequences import find_trajectories
from farpoint.bench.table import Cell, Column, Table
from farpoint.bench.tables.motions_summary import MotionErrors, motions_summary
from farpoint.errors import InputError
from farpoint.synthetic import RenderedSequence, carried, street_drive
from farpoint.trajectory.files import Trajectory

__all__ = ["motions_table"]

_PAIRS = 168
# Pairs of one street share most of their tracks, and with them their errors.
_PAIRS_PER_STREET = 24
_DRIVEN_FPS = (10.0, 30.0)
_CARRIED_FPS = 20.0
_LENSES = {"pinhole, 65 deg": PINHOLE, "fisheye, 195 deg": FISHEYE}


@dataclass(frozen=True, kw_only=True)
class _Motion:
    """A motion of the camera.

    Attributes
    ----------
    name, kind : str
        Name of the motion, and name of the kind of motion.
    fps : float
        Frames per second.
    paths : callable
        Returns paths. The arguments are the number of streets, the number of frames of each path,
        and a seed.
    """

    name: str
    kind: str
    fps: float
    paths: Callable[[int, int, int], list[Trajectory]]


def motions_table(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """The table with a row for each motion and lens, yielded after each row, and the summary."""
    pairs = options.pairs or _PAIRS
    streets, frames = math.ceil(pairs / _PAIRS_PER_STREET), min(pairs, _PAIRS_PER_STREET) + 1
    rows: list[tuple[Cell, ...]] = []
    found: list[MotionErrors] = []
    for motion, lens in itertools.product(_motions(options), _LENSES):
        camera, name = _LENSES[lens], f"{motion.name}, {lens}"
        sequences = [
            RenderedSequence(camera, path, seed=options.seed + k)
            for k, path in enumerate(motion.paths(streets, frames, options.seed))
        ]
        if not sequences:
            continue
        errors = run_rendered(*sequences, progress=partial(progress, name))
        rows.append((motion.name, lens, len(sequences), *rendered_cells(errors)))
        found.append(
            MotionErrors(
                kind=motion.kind,
                fps=motion.fps,
                lens=lens,
                streets=len(sequences),
                errors=errors,
            )
        )
        yield _table(rows, frames, options)
        yield motions_summary(found, options.command("motions"))


def _table(rows: list[tuple[Cell, ...]], frames: int, options: BenchOptions) -> Table:
    return Table(
        name="motions",
        title="Odometry over rendered streets, by how the camera moves",
        command=options.command("motions"),
        columns=(Column("motion"), Column("lens"), Column("streets"), *RENDERED_COLUMNS),
        rows=tuple(rows),
        notes=(
            *RENDERED_NOTES,
            f"{frames - 1} pairs in each street, which share most of their tracks",
            f"measured motions, of --data: {_CARRIED_FPS:g} frames a second, begun anywhere",
        ),
    )


def _motions(options: BenchOptions) -> Iterator[_Motion]:
    for fps in _DRIVEN_FPS:
        yield _Motion(
            name=f"drive, {fps:g} fps", kind="drive", fps=fps, paths=partial(_drives, fps)
        )
    for name, body in find_trajectories(options.data).items():
        yield _Motion(name=name, kind=_kind(name), fps=_CARRIED_FPS, paths=partial(_parts, body))


def _kind(name: str) -> str:
    """Name of the kind of a recording: all characters of ``name`` before the first digit."""
    return re.split(r"\d", name, maxsplit=1)[0].rstrip("-_ ") or name


def _drives(fps: float, streets: int, frames: int, seed: int) -> list[Trajectory]:
    return [street_drive(frames, fps, seed + k) for k in range(streets)]


def _parts(body: Trajectory, streets: int, frames: int, seed: int) -> list[Trajectory]:
    """Parts of a measured motion: one part from each of several equal stretches.

    A stretch in which the motion is lost gives no part.
    """
    assert body.timestamps is not None  # files in TUM's format have time stamps
    duration = body.timestamps[-1] - body.timestamps[0] - frames / _CARRIED_FPS
    places = np.arange(streets) + np.random.default_rng(seed).uniform(size=streets)
    parts = []
    for start_s in np.maximum(duration, 0.0) * places / streets:
        with suppress(InputError):
            parts.append(carried(body, start_s, frames, _CARRIED_FPS))
    return parts
