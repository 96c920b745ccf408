"""Time of one estimate; all estimators take turns on the same matches."""

from __future__ import annotations

import numpy as np

from farpoint.bench.estimators import all_estimators
from farpoint.bench.interleaved import run_interleaved
from farpoint.bench.options import BenchOptions, Progress
from farpoint.bench.scenes import draw_scenes
from farpoint.bench.table import Cell, Column, Table
from farpoint.bench.views import views_of_scene

__all__ = ["timing_table"]

_SCENES = 30
_REPEATS = 3
_SIZES = ((110, 20), (600, 60))  # matches, and outliers among them
_COLUMNS = (
    Column("matches"),
    Column("outliers"),
    Column("estimator"),
    Column("settings"),
    Column("median_ms", 3),
    Column("time_over_farpoint", 2),
)


def timing_table(options: BenchOptions, progress: Progress) -> tuple[Table, ...]:
    """Median time for the paper's number of matches and for the number of matches in a video."""
    rng = np.random.default_rng(options.seed)
    rows: list[tuple[Cell, ...]] = []
    for matches, outliers in _SIZES:
        name = f"time at {matches} matches"
        scenes = draw_scenes(
            options.pairs or _SCENES,
            rng,
            baseline_m=0.05,
            far_share=0.5,
            matches=matches,
            outliers=outliers,
        )
        runs = run_interleaved(
            all_estimators(),
            [views_of_scene(scene) for scene in scenes],
            seed=options.seed,
            repeats=_REPEATS,
            progress=lambda done, total, name=name: progress(name, done, total),
        )
        medians_ms = [1e3 * float(np.median(run.seconds)) for run in runs]
        rows += [
            (
                matches,
                outliers,
                run.estimator.name,
                run.estimator.settings,
                median_ms,
                median_ms / medians_ms[0],
            )
            for run, median_ms in zip(runs, medians_ms, strict=True)
        ]
    return (
        Table(
            name="time",
            title="Time of an estimate on one thread, interleaved on the same matches",
            command=options.command("time"),
            columns=_COLUMNS,
            rows=tuple(rows),
            notes=(
                f"median over {options.pairs or _SCENES} scenes (baseline 5 cm, half of the true "
                "matches far) of the fastest of three calls, after one call without timing; the "
                "conversion of matches to the input of a library is not timed",
                "the time of farpoint includes the covariance, the labels and the status",
            ),
        ),
    )
