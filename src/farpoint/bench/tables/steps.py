"""Accuracy on real images several frames apart, matched by OpenCV, for farpoint and peers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from farpoint.bench.accuracy import REAL_COLUMNS, REAL_NOTES, real_cells
from farpoint.bench.estimators import all_estimators
from farpoint.bench.feature_matcher import FeatureMatcher, Matcher
from farpoint.bench.interleaved import run_interleaved
from farpoint.bench.options import BenchOptions, Progress
from farpoint.bench.plain_script import PlainScript
from farpoint.bench.sequences import PosedSequence, find_sequences, posed_sequence
from farpoint.bench.table import Cell, Column, Table
from farpoint.bench.tables.steps_summary import steps_summary
from farpoint.bench.views import TwoViews, evenly_spaced
from farpoint.camera import Camera

__all__ = ["steps_table"]

_PAIRS = 40
_STEPS = (1, 2, 4, 8)
# Pairs with fewer matches are left out.
_LEAST_MATCHES = 8

_MATCHERS: dict[str, Callable[[Camera], Matcher]] = {
    "Lucas-Kanade": lambda camera: PlainScript(camera, 500),
    "SIFT": lambda _: FeatureMatcher("SIFT"),
}


def steps_table(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """A table with rows for every sequence, kind of match and step, and a summary.

    The tables are yielded again whenever rows are added.
    """
    rows: list[tuple[Cell, ...]] = []
    for sequence in find_sequences(options.data):
        recording = posed_sequence(sequence)
        if recording is None:
            continue
        for kind, make in _MATCHERS.items():
            for step in _STEPS:
                views = _views(recording, make(recording.camera), step, options.pairs or _PAIRS)
                if views:
                    named = sequence.name, kind, step
                    rows += _rows(named, views, options.seed, progress)
                    table = _table(rows, options)
                    yield table
                    yield steps_summary(table)


def _views(recording: PosedSequence, matcher: Matcher, step: int, most: int) -> list[TwoViews]:
    """Pairs of images that are ``step`` frames apart, evenly spaced over the recording."""
    views = []
    for first in evenly_spaced(max(len(recording.images) - step, 0), most):
        points0, points1 = matcher.match(recording.images[first], recording.images[first + step])
        if len(points0) < _LEAST_MATCHES:
            continue
        motion = recording.cam1_from_cam0(first, first + step)
        views.append(
            TwoViews(
                camera=recording.camera,
                points0=points0,
                points1=points1,
                rotation_cam1_from_cam0=motion[:3, :3],
                translation_cam1_from_cam0=motion[:3, 3],
            )
        )
    return views


def _rows(
    named: tuple[str, str, int], views: Sequence[TwoViews], seed: int, progress: Progress
) -> list[tuple[Cell, ...]]:
    name, kind, step = named
    runs = run_interleaved(
        all_estimators(),
        views,
        seed=seed,
        progress=lambda done, total: progress(f"{name}, {kind}, {step} apart", done, total),
    )
    matches = round(float(np.median([len(v.points0) for v in views])))
    cells = real_cells(runs, views)
    return [
        (*named, len(views), matches, run.estimator.name, *each)
        for run, each in zip(runs, cells, strict=True)
    ]


def _table(rows: list[tuple[Cell, ...]], options: BenchOptions) -> Table:
    return Table(
        name="steps",
        title="Real images several frames apart: errors against the truth",
        command=options.command("steps"),
        columns=(
            Column("sequence"),
            Column("kind"),
            Column("step"),
            Column("pairs"),
            Column("matches"),
            Column("estimator"),
            *REAL_COLUMNS,
        ),
        rows=tuple(rows),
        notes=(
            f"pairs spread evenly over each sequence; those of fewer than {_LEAST_MATCHES} matches "
            "are none",
            "tracks as the plain script makes them, features by the ratio of their distances",
            *REAL_NOTES,
        ),
    )
