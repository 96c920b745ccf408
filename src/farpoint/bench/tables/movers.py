"""Accuracy with an object that moves by itself or with the camera, for farpoint and peers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from farpoint.bench.accuracy import ERROR_COLUMNS, error_cells, errors_of
from farpoint.bench.consistency import coverage_cells, pose_errors
from farpoint.bench.estimators import all_estimators
from farpoint.bench.interleaved import run_interleaved
from farpoint.bench.options import BenchOptions, Progress
from farpoint.bench.scenes import draw_scenes
from farpoint.bench.table import Cell, Column, Table
from farpoint.bench.views import TwoViews, views_of_scene
from farpoint.metrics import consistency
from farpoint.pose import estimate_relative_pose

__all__ = ["movers_table", "with_mover", "with_stationary"]

_PAIRS = 60
_BASELINE_M = 0.1
_MATCHES = 300
_SHARES = (0.1, 0.2, 0.3, 0.4)
_NOISE_PX = 0.22
_COLUMNS = (
    Column("moving_percent"),
    Column("moves"),
    Column("estimator"),
    *ERROR_COLUMNS,
    Column("pose_95", 3),
    Column("pose_95_low", 3),
    Column("pose_95_high", 3),
)


def movers_table(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """Rows for each share of the matches on a moving object, and each motion of the object."""
    rng = np.random.default_rng(options.seed)
    rows: list[tuple[Cell, ...]] = []
    for share in _SHARES:
        for moves, make in _MOVES.items():
            rows += _cell_rows(share, moves, make, options, rng, progress)
            yield _table(rows, options)


def with_mover(
    views: TwoViews, share: float, rng: np.random.Generator, *, shift_px: float
) -> TwoViews:
    """Views with an object that moves by itself.

    ``share`` is the share of the matches that are on the object: a random match, and the matches
    nearest to this match in image 0. In image 1 all matches on the object are displaced by
    ``shift_px`` in the same random direction.
    """
    middle, angle = views.points0[rng.integers(len(views.points0))], rng.uniform(0.0, 2 * math.pi)
    nearest = np.argsort(np.linalg.norm(views.points0 - middle, axis=1))
    points1 = views.points1.copy()
    displaced = nearest[: round(share * len(nearest))]
    points1[displaced] += shift_px * np.array([math.cos(angle), math.sin(angle)])
    return replace(views, points1=points1)


def with_stationary(views: TwoViews, share: float, rng: np.random.Generator) -> TwoViews:
    """Views through a dirty lens, with matches that stand still.

    ``share`` is the share of such matches, which are anywhere in the image.
    """
    stationary = rng.permutation(len(views.points0))[: round(share * len(views.points0))]
    points1 = views.points1.copy()
    points1[stationary] = views.points0[stationary] + rng.normal(
        0.0, _NOISE_PX, (len(stationary), 2)
    )
    return replace(views, points1=points1)


# Moving parts of the image, by their names in the table.
_Make = Callable[[TwoViews, float, np.random.Generator], TwoViews]
_MOVES: dict[str, _Make] = {
    "1 px aside": partial(with_mover, shift_px=1.0),
    "3 px aside": partial(with_mover, shift_px=3.0),
    "10 px aside": partial(with_mover, shift_px=10.0),
    "with the camera": with_stationary,
}


def _table(rows: list[tuple[Cell, ...]], options: BenchOptions) -> Table:
    return Table(
        name="movers",
        title="Scenes with a moving object: errors of the camera's motion",
        command=options.command("movers"),
        columns=_COLUMNS,
        rows=tuple(rows),
        notes=(
            f"{options.pairs or _PAIRS} pairs a cell, the same for all: {_MATCHES} matches, noise "
            f"{_NOISE_PX:g} px, {100 * _BASELINE_M:g} cm, turns up to 5 deg about every axis; half "
            "of the points at 1-4 m, half at 25-35 m",
            "aside: the matches nearest to a random point are shifted by shift_px in image 1, in "
            "a random direction",
            "with the camera: matches anywhere stand still in the image, like dirt on the lens",
            "means are over the pairs with an estimate; gross: rotation more than 1 deg or "
            "direction more than 30 deg off",
            "pose_95: share of the 95 % regions that contain the truth; the peers have no regions",
        ),
    )


def _cell_rows(
    share: float,
    moves: str,
    make: _Make,
    options: BenchOptions,
    rng: np.random.Generator,
    progress: Progress,
) -> list[tuple[Cell, ...]]:
    scenes = draw_scenes(
        options.pairs or _PAIRS,
        rng,
        baseline_m=_BASELINE_M,
        far_share=0.5,
        matches=_MATCHES,
        outliers=0,
        noise_px=_NOISE_PX,
    )
    views = [make(views_of_scene(scene), share, rng) for scene in scenes]
    name = f"{100 * share:g} % move {moves}"
    runs = run_interleaved(
        all_estimators(),
        views,
        seed=options.seed,
        progress=lambda done, total: progress(name, done, total),
    )
    covered = _coverage(views, options.seed), *[(None,) * 3] * len(runs[1:])
    return [
        (
            round(100 * share),
            moves,
            run.estimator.name,
            *error_cells(errors_of(run, views)),
            *each,
        )
        for run, each in zip(runs, covered, strict=True)
    ]


def _coverage(views: list[TwoViews], seed: int) -> tuple[Cell, ...]:
    """Share of farpoint's 95 % regions that contain the truth, and 95 % interval of this share."""
    poses = [estimate_relative_pose(v.points0, v.points1, v.camera, seed=seed) for v in views]
    errors = pose_errors(
        poses,
        np.array([v.rotation_cam1_from_cam0 for v in views]),
        np.array([v.translation_cam1_from_cam0 for v in views]),
    )
    return coverage_cells(consistency(errors.errors, errors.covariances))
