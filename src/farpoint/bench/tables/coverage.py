"""The table of coverage: tests of the covariances in each cell of a grid of scenes."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from farpoint.bench.consistency import CONSISTENCY_COLUMNS, consistency_cells, pose_errors
from farpoint.bench.options import BenchOptions, CoverageGrid, Progress
from farpoint.bench.scenes import draw_scenes
from farpoint.bench.table import Cell, Column, Table
from farpoint.bench.tables.coverage_summary import coverage_summary
from farpoint.pose import PoseStatus, estimate_relative_pose
from farpoint.synthetic import PointScene, cramer_rao_bound

__all__ = ["coverage_table"]

_COLUMNS = (
    Column("baseline_cm"),
    Column("far_percent"),
    Column("noise_px", 2),
    Column("outliers_percent"),
    Column("matches"),
    *(Column(status.value) for status in PoseStatus),
    Column("observable"),
    Column("observable_OK"),
    *CONSISTENCY_COLUMNS,
)
# A direction whose Cramer-Rao bound (1 sigma) is below this along every axis can be observed.
_OBSERVABLE = math.radians(5.0)


def coverage_table(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """The table with a row for each cell of the grid, yielded after each row, and the summary."""
    grid = CoverageGrid.whole() if options.full else options.grid
    cells = list(
        product(
            grid.baselines_m, grid.far_shares, grid.noises_px, grid.outlier_shares, grid.matches
        )
    )
    rng = np.random.default_rng(options.seed)
    rows: list[tuple[Cell, ...]] = []
    for done, (baseline_m, far_share, noise_px, outlier_share, matches) in enumerate(cells):
        progress("coverage", done, len(cells))
        scenes = draw_scenes(
            grid.trials,
            rng,
            baseline_m=baseline_m,
            far_share=far_share,
            matches=matches,
            outliers=round(outlier_share * matches),
            noise_px=noise_px,
        )
        cell = (
            float(100 * baseline_m),
            round(100 * far_share),
            noise_px,
            round(100 * outlier_share),
            matches,
        )
        rows.append((*cell, *_figures(scenes, options.seed)))
        table = _table(rows, grid, options)
        yield table
        yield coverage_summary(table)
    progress("coverage", len(cells), len(cells))


def _table(rows: Sequence[tuple[Cell, ...]], grid: CoverageGrid, options: BenchOptions) -> Table:
    return Table(
        name="coverage",
        title="Coverage: share of the 68 % and 95 % regions that contain the truth",
        command=options.command("coverage"),
        columns=_COLUMNS,
        rows=tuple(rows),
        notes=(
            f"{grid.trials} scenes a cell; low, high: 95 % binomial interval of the coverage",
            "pose: rotation and direction of pairs that are OK, 5 degrees of freedom; rotation: "
            "of all pairs that are not FAILED, 3 degrees of freedom; nees: mean NEES, ideally "
            "the degrees of freedom",
            "sigma_over_error: factor by which the sigmas are too large (above 1) or too small, "
            "by the median error",
            "observable: motions whose direction has a Cramer-Rao bound below 5 degrees along "
            "every axis (1 sigma); observable_OK: observable motions that are "
            f"OK{_share_observed(rows)}",
            "at baseline 0 the camera does not translate, so OK is a false alarm and the "
            "direction has no truth",
        ),
    )


def _share_observed(rows: Sequence[tuple[Cell, ...]]) -> str:
    """Text with the share of the observable motions whose status is OK."""
    names = [column.name for column in _COLUMNS]
    observable, ok = (
        sum(int(row[names.index(name)] or 0) for row in rows)
        for name in ("observable", "observable_OK")
    )
    return f", over all rows, {ok} of {observable} ({ok / observable:.1%})" if observable else ""


def _figures(scenes: Sequence[PointScene], seed: int) -> tuple[Cell, ...]:
    poses = [
        estimate_relative_pose(scene.points0, scene.points1, scene.camera, seed=seed)
        for scene in scenes
    ]
    errors = pose_errors(
        poses,
        np.array([scene.rotation_cam1_from_cam0 for scene in scenes]),
        np.array([scene.translation_cam1_from_cam0 for scene in scenes]),
    )
    counts = Counter(pose.status for pose in poses)
    observable = [pose for scene, pose in zip(scenes, poses, strict=True) if _is_observable(scene)]
    return (
        *(counts[status] for status in PoseStatus),
        len(observable),
        sum(pose.status is PoseStatus.OK for pose in observable),
        *consistency_cells(errors),
    )


def _is_observable(scene: PointScene) -> bool:
    if not scene.translation_cam1_from_cam0.any():
        return False
    variances = np.linalg.eigvalsh(cramer_rao_bound(scene)[3:, 3:])
    return bool(variances[-1] < _OBSERVABLE**2)
