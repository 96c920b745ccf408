"""Time of an estimate by number of matches, share of outliers, and length of the step."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from farpoint.bench.chart import line_chart
from farpoint.bench.estimators import Estimator, all_estimators
from farpoint.bench.interleaved import run_interleaved
from farpoint.bench.options import BenchOptions, Progress
from farpoint.bench.scenes import draw_scenes
from farpoint.bench.table import Cell, Column, Table
from farpoint.bench.views import views_of_scene

__all__ = ["scaling_tables"]

_SCENES = 10
_REPEATS = 3
_MATCHES = (8, 20, 50, 110, 300, 500, 1000, 2000, 5000)
_OUTLIER_PERCENTS = (0, 10, 20, 30, 40, 50, 60)
_OUTLIER_PERCENT = 10  # in the table by number of matches
_OUTLIER_MATCHES = 500  # number of matches in the table by share of outliers
_BASELINES_CM = (20.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.0)
_BASELINE_CM = 5.0  # in both of these tables
_BASELINE_SIZE = (110, 20)  # matches and outliers in the table by length of the step


def scaling_tables(options: BenchOptions, progress: Progress) -> tuple[Table, ...]:
    """Tables with rows by number of matches, by share of outliers, and by length of the step."""
    estimators = all_estimators()
    by_matches = _median_ms(
        [(n, round(_OUTLIER_PERCENT / 100 * n), _BASELINE_CM) for n in _MATCHES],
        estimators,
        options,
        lambda done, total: progress("growth with matches", done, total),
    )
    by_outliers = _median_ms(
        [
            (_OUTLIER_MATCHES, round(p / 100 * _OUTLIER_MATCHES), _BASELINE_CM)
            for p in _OUTLIER_PERCENTS
        ],
        estimators,
        options,
        lambda done, total: progress("growth with outliers", done, total),
    )
    by_baselines = _median_ms(
        [(*_BASELINE_SIZE, baseline_cm) for baseline_cm in _BASELINES_CM],
        estimators,
        options,
        lambda done, total: progress("growth with shorter steps", done, total),
    )
    ratio = by_matches[_MATCHES.index(5000), 0] / by_matches[_MATCHES.index(500), 0]
    return (
        _scaling_table(
            "time_matches",
            f"Growth with the number of matches, {_OUTLIER_PERCENT} % of them wrong",
            Column("matches"),
            "matches",
            _MATCHES,
            by_matches,
            estimators,
            options,
            (f"farpoint: 5000 matches take {ratio:.1f} times as long as 500",),
        ),
        _scaling_table(
            "time_outliers",
            f"Growth with the share of wrong matches, of {_OUTLIER_MATCHES}",
            Column("outliers_percent"),
            "wrong matches, %",
            _OUTLIER_PERCENTS,
            by_outliers,
            estimators,
            options,
            (),
        ),
        _scaling_table(
            "time_baselines",
            "Growth with shorter steps, {} matches, {} of them wrong".format(*_BASELINE_SIZE),
            Column("baseline_cm", 1),
            "length of the translation, cm",
            _BASELINES_CM,
            by_baselines,
            estimators,
            options,
            ("half of the matches are 1-4 m away; at 0 m the result of farpoint is ROTATION_ONLY",),
        ),
    )


def _median_ms(
    cells: Sequence[tuple[int, int, float]],
    estimators: Sequence[Estimator],
    options: BenchOptions,
    progress: Callable[[int, int], None],
) -> np.ndarray:
    """Median times (cells, estimators), ms.

    Each cell has a number of matches, a number of outliers, and the length of a step in cm.

    The cells also take turns, because the tables are made to compare the times of the cells.
    """
    rng = np.random.default_rng(options.seed)
    rounds = min(options.pairs or _SCENES, _SCENES)
    scenes = [
        draw_scenes(
            1,
            rng,
            baseline_m=0.01 * baseline_cm,
            far_share=0.5,
            matches=matches,
            outliers=outliers,
        )[0]
        for _ in range(rounds)
        for matches, outliers, baseline_cm in cells
    ]
    views = [views_of_scene(scene) for scene in scenes]
    runs = run_interleaved(
        estimators, views, seed=options.seed, repeats=_REPEATS, progress=progress
    )
    seconds = np.array([run.seconds.reshape(rounds, len(cells)) for run in runs])
    return 1e3 * np.median(seconds, axis=1).T


def _scaling_table(
    name: str,
    title: str,
    first: Column,
    x_label: str,
    keys: Sequence[float],
    medians_ms: np.ndarray,
    estimators: Sequence[Estimator],
    options: BenchOptions,
    notes: tuple[str, ...],
) -> Table:
    rows: list[tuple[Cell, ...]] = [
        (key, *map(float, row)) for key, row in zip(keys, medians_ms, strict=True)
    ]
    names = [estimator.name for estimator in estimators]
    return Table(
        name=name,
        title=f"{title}: median time of an estimate, ms",
        command=options.command("time"),
        columns=(first, *(Column(f"{e.replace(' ', '_')}_ms", 3) for e in names)),
        rows=tuple(rows),
        notes=notes,
        chart=line_chart(
            title,
            x_label,
            "ms",
            np.array(keys, dtype=np.float64),
            dict(zip(names, medians_ms.T, strict=True)),
            log_x=min(keys) > 0,
        ),
    )
