"""Accuracy on pairs that are known to be hard, for farpoint and peers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from farpoint.bench.accuracy import ERROR_COLUMNS, GROSS_DIRECTION_DEG, error_cells, errors_of
from farpoint.bench.consistency import coverage_cells, pose_errors
from farpoint.bench.estimators import all_estimators
from farpoint.bench.interleaved import run_interleaved
from farpoint.bench.options import BenchOptions, Progress
from farpoint.bench.table import Cell, Column, Table
from farpoint.bench.views import TwoViews, views_of_scene
from farpoint.geometry import sphere
from farpoint.metrics import consistency
from farpoint.pose import RelativePose, estimate_relative_pose
from farpoint.synthetic.pairs import KINDS

__all__ = ["count_sure_and_wrong", "scenes_table"]

_PAIRS = 60
# Number of seeds of pairs that are reserved for each seed of the benchmark.
_SEEDS = 100_000
# A direction counts as sure if its 1-sigma along the longest axis, deg, is below this.
_SURE_DEG = 10.0
_OWN_COLUMNS = (
    Column("sure_wrong"),
    Column("rotation_95", 3),
    Column("rotation_95_low", 3),
    Column("rotation_95_high", 3),
    Column("pose_95", 3),
    Column("pose_95_low", 3),
    Column("pose_95_high", 3),
)
_COLUMNS = (Column("scene"), Column("estimator"), *ERROR_COLUMNS, *_OWN_COLUMNS)


def scenes_table(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """Rows for each kind of `farpoint.synthetic.pairs`, and each estimator."""
    rows: list[tuple[Cell, ...]] = []
    for kind in KINDS:
        rows += _kind_rows(kind, options, progress)
        yield _table(rows, options)


def count_sure_and_wrong(poses: Sequence[RelativePose], views: Sequence[TwoViews]) -> int:
    """Number of directions with a small sigma and a large error.

    The largest 1-sigma of such a direction is below 10 degrees, and the error is above 30 degrees.
    If the camera does not translate, every direction with such a sigma counts.
    """
    return sum(
        _is_sure(pose) and _is_wrong(pose, pair) for pose, pair in zip(poses, views, strict=True)
    )


def _is_sure(pose: RelativePose) -> bool:
    if pose.covariance is None:
        return False
    variance = np.linalg.eigvalsh(pose.covariance[3:, 3:])[-1]
    return bool(np.degrees(np.sqrt(variance)) < _SURE_DEG)


def _is_wrong(pose: RelativePose, views: TwoViews) -> bool:
    translation = views.translation_cam1_from_cam0
    if pose.direction_cam1_from_cam0 is None:
        return False
    if not translation.any():
        return True
    true = sphere.normalize(translation)
    error = np.degrees(sphere.angle_between(pose.direction_cam1_from_cam0, true))
    return bool(error > GROSS_DIRECTION_DEG)


def _table(rows: list[tuple[Cell, ...]], options: BenchOptions) -> Table:
    return Table(
        name="scenes",
        title="Scenes that are known to be hard: errors of the motion",
        command=options.command("scenes"),
        columns=_COLUMNS,
        rows=tuple(rows),
        notes=(
            f"{options.pairs or _PAIRS} pairs a scene, the same for all; farpoint.synthetic.pairs "
            "makes and describes the scenes",
            "means are over the pairs with an estimate; gross: rotation more than 1 deg or "
            "direction more than 30 deg off",
            "without a translation (turns, camera at rest) there is no true direction: only "
            "rotations are compared, and no_direction is right",
            "wrong matches alone: these have no true motion; failed is right, and the errors are "
            "those against a camera at rest",
            f"sure_wrong: directions more than {GROSS_DIRECTION_DEG:g} deg off whose largest sigma "
            f"is below {_SURE_DEG:g} deg; without a translation, every direction with such a sigma",
            "rotation_95, pose_95: share of the 95 % regions that contain the truth; the peers "
            "have no covariances",
        ),
    )


def _kind_rows(kind: str, options: BenchOptions, progress: Progress) -> list[tuple[Cell, ...]]:
    first = _SEEDS * options.seed
    seeds = range(first, first + (options.pairs or _PAIRS))
    views = [views_of_scene(KINDS[kind](seed)) for seed in seeds]
    runs = run_interleaved(
        all_estimators(),
        views,
        seed=options.seed,
        progress=lambda done, total: progress(kind, done, total),
    )
    own = _own_cells(views, options.seed), *[(None,) * len(_OWN_COLUMNS)] * len(runs[1:])
    return [
        (kind, run.estimator.name, *error_cells(errors_of(run, views)), *each)
        for run, each in zip(runs, own, strict=True)
    ]


def _own_cells(views: list[TwoViews], seed: int) -> tuple[Cell, ...]:
    """Cells of farpoint's covariances, in the order of `_OWN_COLUMNS`."""
    poses = [estimate_relative_pose(v.points0, v.points1, v.camera, seed=seed) for v in views]
    found = pose_errors(
        poses,
        np.array([v.rotation_cam1_from_cam0 for v in views]),
        np.array([v.translation_cam1_from_cam0 for v in views]),
    )
    errors, covariances = found.errors, found.covariances
    return (
        count_sure_and_wrong(poses, views),
        *coverage_cells(consistency(errors[:, :3], covariances[:, :3, :3])),
        *coverage_cells(consistency(errors, covariances)),
    )
