"""Accuracy and time on matches of real images, against every installed peer."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from farpoint.bench.accuracy import REAL_COLUMNS, REAL_NOTES, real_cells
from farpoint.bench.estimators import all_estimators
from farpoint.bench.interleaved import run_interleaved
from farpoint.bench.match_files import find_match_files, read_matches
from farpoint.bench.options import BenchOptions, Progress
from farpoint.bench.table import Cell, Column, Table
from farpoint.bench.views import TwoViews, evenly_spaced

__all__ = ["pairs_table"]

_PAIRS = 60
_REPEATS = 3
_COLUMNS = (
    Column("data"),
    Column("pairs"),
    Column("matches"),
    Column("estimator"),
    *REAL_COLUMNS,
    Column("median_ms", 3),
    Column("time_over_farpoint", 2),
    Column("first_ms", 3),
    Column("first_over_farpoint", 2),
)


def pairs_table(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """Rows for every file of matches in the data, file by file."""
    rows: list[tuple[Cell, ...]] = []
    for path in find_match_files(options.data):
        found = read_matches(path)
        most = len(found.views) if options.full else options.pairs or _PAIRS
        views = tuple(found.views[k] for k in evenly_spaced(len(found.views), most))
        if views:
            rows += _file_rows(found.name, views, options.seed, progress)
            yield _table(rows, options)


def _table(rows: list[tuple[Cell, ...]], options: BenchOptions) -> Table:
    return Table(
        name="pairs",
        title="Real pairs: errors against the truth, and time",
        command=options.command("pairs"),
        columns=_COLUMNS,
        rows=tuple(rows),
        notes=(
            "pairs are spread evenly over each file, the same for all estimators, which take "
            "turns on one thread; times: the best of three calls, and the first call, with cold "
            "caches",
            "peers get points without lens distortion; this conversion is not timed",
            "the truth is noisy, too: that of KITTI by 0.02-0.04 deg from frame to frame",
            *REAL_NOTES,
        ),
    )


def _file_rows(
    name: str, views: tuple[TwoViews, ...], seed: int, progress: Progress
) -> list[tuple[Cell, ...]]:
    runs = run_interleaved(
        all_estimators(),
        views,
        seed=seed,
        repeats=_REPEATS,
        progress=lambda done, total: progress(f"pairs of {name}", done, total),
    )
    medians_ms = [1e3 * float(np.median(run.seconds)) for run in runs]
    firsts_ms = [1e3 * float(np.median(run.first_seconds)) for run in runs]
    cells = real_cells(runs, views)
    rows: list[tuple[Cell, ...]] = []
    entries = zip(runs, cells, medians_ms, firsts_ms, strict=True)
    for run, each, median_ms, first_ms in entries:
        rows.append(
            (
                name,
                len(views),
                round(float(np.median([len(v.points0) for v in views]))),
                run.estimator.name,
                *each,
                median_ms,
                median_ms / medians_ms[0],
                first_ms,
                first_ms / firsts_ms[0],
            )
        )
    return rows
