"""Whether the covariances keep their promise, cell by cell."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from farpoint.bench.options import BenchOptions, CoverageGrid, Progress
from farpoint.bench.scenes import draw_scenes
from farpoint.bench.table import Cell, Column, Table
from farpoint.metrics import Consistency, PairErrors, consistency, pair_errors
from farpoint.pose import PoseStatus, RelativePose, estimate_relative_pose
from farpoint.synthetic import PointScene

__all__ = ["coverage_table"]

_COLUMNS = (
    Column("baseline_cm"),
    Column("far_percent"),
    Column("noise_px", 2),
    Column("outliers_percent"),
    Column("matches"),
    *(Column(status.value) for status in PoseStatus),
    *(
        column
        for name in ("pose", "rotation")
        for column in (
            Column(f"{name}_68", 3),
            Column(f"{name}_95", 3),
            Column(f"{name}_95_low", 3),
            Column(f"{name}_95_high", 3),
            Column(f"{name}_nees", 1),
            Column(f"{name}_sigma_over_error", 2),
        )
    ),
)


def coverage_table(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """A row for each cell of the grid, as they are filled."""
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
        yield _table(rows, grid, options)
    progress("coverage", len(cells), len(cells))


def _table(rows: Sequence[tuple[Cell, ...]], grid: CoverageGrid, options: BenchOptions) -> Table:
    return Table(
        name="coverage",
        title="Coverage: how often the 68 % and 95 % regions of the covariances hold the truth",
        command=options.command("coverage"),
        columns=_COLUMNS,
        rows=tuple(rows),
        notes=(
            f"{grid.trials} scenes a cell; low, high: 95 % binomial interval of the coverage",
            "pose: rotation and direction where the status is OK, 5 degrees of freedom; "
            "rotation: all but FAILED, 3; nees: mean, ideally the degrees of freedom",
            "sigma_over_error: above 1 the sigmas are too large by this factor (median)",
            "at baseline 0 nothing moves, so OK is a false alarm and the pose has no truth",
        ),
    )


def _figures(scenes: Sequence[PointScene], seed: int) -> tuple[Cell, ...]:
    poses = [
        estimate_relative_pose(scene.points0, scene.points1, scene.camera, seed=seed)
        for scene in scenes
    ]
    errors = _errors(poses, scenes)
    counts = Counter(pose.status for pose in poses)
    return (
        *(counts[status] for status in PoseStatus),
        *_consistency_cells(consistency(errors.errors, errors.covariances)),
        *_consistency_cells(consistency(errors.errors[:, :3], errors.covariances[:, :3, :3])),
    )


def _errors(poses: Sequence[RelativePose], scenes: Sequence[PointScene]) -> PairErrors:
    return pair_errors(
        statuses=[pose.status for pose in poses],
        rotations=np.array([_or_nan(p.rotation_cam1_from_cam0, 3, 3) for p in poses]),
        directions=np.array([_or_nan(p.direction_cam1_from_cam0, 3) for p in poses]),
        direction_bases=np.array([_or_nan(p.direction_basis, 3, 2) for p in poses]),
        covariances=np.array([_covariance(pose) for pose in poses]),
        true_rotations=np.array([scene.rotation_cam1_from_cam0 for scene in scenes]),
        true_translations=np.array([scene.translation_cam1_from_cam0 for scene in scenes]),
    )


def _or_nan(values: np.ndarray | None, *shape: int) -> np.ndarray:
    return np.full(shape, np.nan) if values is None else values


def _covariance(pose: RelativePose) -> np.ndarray:
    covariance = np.full((5, 5), np.nan)
    if pose.covariance is not None:
        return pose.covariance
    if pose.rotation_covariance is not None:
        covariance[:3, :3] = pose.rotation_covariance
    return covariance


def _consistency_cells(found: Consistency) -> tuple[Cell, ...]:
    if not found.count:
        return (None,) * 6
    return (
        found.coverage68.share,
        found.coverage95.share,
        found.coverage95.low,
        found.coverage95.high,
        found.mean_nees,
        found.sigma_over_error,
    )
