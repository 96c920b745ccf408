"""The simulation table of Burschka and Mair (2008), with the closed form and farpoint."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ellipe

from farpoint.bench.accuracy import errors_of
from farpoint.bench.estimators import CLOSED_FORM, FARPOINT
from farpoint.bench.interleaved import run_interleaved
from farpoint.bench.options import BenchOptions, Progress
from farpoint.bench.table import Cell, Column, Table
from farpoint.bench.views import views_of_scene
from farpoint.metrics import summarize
from farpoint.synthetic import PointScene, cramer_rao_bound, make_point_scene, paper_protocol

__all__ = ["paper_table"]

_DEG = 180.0 / math.pi

_PAIRS = 2000
_COLUMNS = (
    Column("method"),
    Column("pairs"),
    Column("rotation_x_deg", 4),
    Column("rotation_y_deg", 4),
    Column("rotation_z_deg", 4),
    Column("direction_deg", 2),
    Column("failed"),
    Column("no_direction"),
    Column("gross"),
)
_PUBLISHED: tuple[Cell, ...] = (
    "Burschka & Mair 2008",
    2000,
    0.0113,
    0.0107,
    0.0231,
    2.59,
    0,
    None,
    None,
)


def paper_table(options: BenchOptions, progress: Progress) -> tuple[Table, ...]:
    """Mean absolute errors over random pairs that are drawn by the paper's protocol."""
    rng = np.random.default_rng(options.seed)
    count = options.pairs or _PAIRS
    scenes = [make_point_scene(paper_protocol(rng), seed=rng) for _ in range(count)]
    views = [views_of_scene(scene) for scene in scenes]
    runs = run_interleaved(
        (CLOSED_FORM, FARPOINT),
        views,
        seed=options.seed,
        progress=lambda done, total: progress("paper", done, total),
    )
    rows = [_PUBLISHED]
    for run in runs:
        errors = errors_of(run, views)
        rows.append(
            (
                run.estimator.name,
                count,
                *(summarize(np.abs(axis)).scaled(_DEG).mean for axis in errors.dtheta_rad.T),
                summarize(errors.direction_deg).mean,
                errors.failed,
                errors.undecided,
                errors.gross,
            )
        )
    rows.append(("Cramer-Rao bound", count, *_bound_figures(scenes), None, None, None))
    return (
        Table(
            name="paper",
            title="The paper's simulation: mean absolute error per axis, mean angle of direction",
            command=options.command("paper"),
            columns=_COLUMNS,
            rows=tuple(rows),
            notes=(
                "89.8 matches on average, 20 of them wrong, noise variance 0.05 px^2; "
                "farpoint.synthetic.paper_protocol documents the values that the paper does not "
                "give",
                "no_direction: the direction is reported as not observable; gross: rotation more "
                "than 1 deg or direction more than 30 deg off",
                "the bound is that of an estimator without knowledge of the depths; the closed "
                "form assumes that far points are infinitely far, which helps if they are",
            ),
        ),
    )


def _bound_figures(scenes: list[PointScene]) -> tuple[float, float, float, float]:
    """Mean absolute errors, deg, of Gaussian errors whose covariance is the Cramer-Rao bound."""
    bounds = np.array([cramer_rao_bound(scene) for scene in scenes])
    sigmas = np.sqrt(np.diagonal(bounds[:, :3, :3], axis1=1, axis2=2))
    x, y, z = np.degrees(math.sqrt(2.0 / math.pi) * np.mean(sigmas, axis=0))
    small, large = np.linalg.eigvalsh(bounds[:, 3:, 3:]).T
    lengths = math.sqrt(2.0 / math.pi) * np.sqrt(large) * ellipe(1.0 - small / large)
    return float(x), float(y), float(z), float(np.degrees(np.mean(lengths)))
