"""The table of accuracy: errors against the Cramer-Rao bound and against every installed peer."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from farpoint.bench.accuracy import bound_ratios, errors_of
from farpoint.bench.estimators import all_estimators
from farpoint.bench.interleaved import run_interleaved
from farpoint.bench.options import BenchOptions, Progress
from farpoint.bench.scenes import draw_scenes
from farpoint.bench.table import Cell, Column, Table
from farpoint.bench.views import views_of_scene
from farpoint.metrics import summarize
from farpoint.synthetic import cramer_rao_bound

__all__ = ["accuracy_table"]

_PAIRS = 300
_BASELINES_M = (0.02, 0.05, 0.2)
_FAR_SHARES = (0.5, 0.0)
_COLUMNS = (
    Column("baseline_cm"),
    Column("far_percent"),
    Column("estimator"),
    Column("rotation_over_bound", 3),
    Column("direction_over_bound", 3),
    Column("rotation_mean_deg", 4),
    Column("direction_mean_deg", 3),
    Column("failed"),
    Column("no_direction"),
    Column("gross"),
)


def accuracy_table(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """The table for the paper's protocol, yielded after each cell.

    Each scene has 110 matches, of which 20 are outliers. The noise is 0.22 px.
    """
    rng = np.random.default_rng(options.seed)
    rows: list[tuple[Cell, ...]] = []
    for baseline_m in _BASELINES_M:
        for far_share in _FAR_SHARES:
            rows += _cell_rows(baseline_m, far_share, options, rng, progress)
            yield _table(rows, options)


def _table(rows: list[tuple[Cell, ...]], options: BenchOptions) -> Table:
    return Table(
        name="accuracy",
        title="Accuracy: errors over the Cramer-Rao bound (1 is the best), and mean errors",
        command=options.command("accuracy"),
        columns=_COLUMNS,
        rows=tuple(rows),
        notes=(
            f"{options.pairs or _PAIRS} pairs a cell, the same for all estimators: 110 matches, "
            "20 of them wrong, noise 0.22 px, turns up to 5 deg about every axis; near points at "
            "1-4 m, far ones at 25-35 m",
            "over_bound: median of the normalised error over the median of chi; a missing "
            "estimate counts as an infinite error",
            "means are over the pairs with an estimate, gross errors included; gross: rotation "
            "more than 1 deg or direction more than 30 deg off",
        ),
    )


def _cell_rows(
    baseline_m: float,
    far_share: float,
    options: BenchOptions,
    rng: np.random.Generator,
    progress: Progress,
) -> list[tuple[Cell, ...]]:
    name = f"accuracy at {100 * baseline_m:g} cm, {100 * far_share:g} % far"
    scenes = draw_scenes(
        options.pairs or _PAIRS,
        rng,
        baseline_m=baseline_m,
        far_share=far_share,
        matches=110,
        outliers=20,
    )
    bounds = np.array([cramer_rao_bound(scene) for scene in scenes])
    views = [views_of_scene(scene) for scene in scenes]
    runs = run_interleaved(
        all_estimators(),
        views,
        seed=options.seed,
        progress=lambda done, total: progress(name, done, total),
    )
    rows: list[tuple[Cell, ...]] = []
    for run in runs:
        errors = errors_of(run, views)
        rows.append(
            (
                round(100 * baseline_m),
                round(100 * far_share),
                run.estimator.name,
                *bound_ratios(run, views, bounds),
                summarize(errors.rotation_deg).mean,
                summarize(errors.direction_deg).mean,
                errors.failed,
                errors.undecided,
                errors.gross,
            )
        )
    return rows
