"""The table of things that move by themselves."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from bench_kit import silent, some_views

from farpoint.bench.estimators import FARPOINT
from farpoint.bench.options import BenchOptions
from farpoint.bench.tables import movers


def test_what_moves_is_one_region_and_moves_as_one():
    views, rng = some_views(1)[0], np.random.default_rng(1)
    moved = movers.with_mover(views, 0.3, rng, shift_px=4.0)
    shift = moved.points1 - views.points1
    moves = np.any(shift != 0.0, axis=1)
    assert moves.sum() == round(0.3 * len(views.points0))
    np.testing.assert_allclose(np.linalg.norm(shift[moves], axis=1), 4.0)
    assert np.ptp(shift[moves], axis=0).max() < 1e-9
    evenly_spaced = [np.std(views.points0[which], axis=0).mean() for which in (moves, ~moves)]
    assert evenly_spaced[0] < evenly_spaced[1]


def test_dirt_is_anywhere_and_stands_still_but_for_the_noise():
    views, rng = some_views(1)[0], np.random.default_rng(1)
    moved = movers.with_stationary(views, 0.3, rng)
    stationary = np.any(moved.points1 != views.points1, axis=1)
    assert stationary.sum() == round(0.3 * len(views.points0))
    flow = moved.points1[stationary] - views.points0[stationary]
    assert 0.15 < np.std(flow) < 0.3
    evenly_spaced = [
        np.std(views.points0[which], axis=0).mean() for which in (stationary, ~stationary)
    ]
    assert evenly_spaced[0] > 0.7 * evenly_spaced[1]


def test_a_cell_has_a_row_for_each_estimator(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(movers, "_SHARES", (0.2,))
    monkeypatch.setattr(movers, "_MOVES", {"with the camera": movers.with_stationary})
    (table,) = movers.movers_table(BenchOptions(tables=("movers",), pairs=3), silent)
    rows = [dict(zip((c.name for c in table.columns), row, strict=True)) for row in table.rows]
    assert rows[0]["estimator"] == "farpoint"
    assert all((row["moving_percent"], row["moves"]) == (20, "with the camera") for row in rows)
    assert rows[0]["rotation_median_deg"] < 0.1
    assert rows[0]["failed"] == 0
    assert rows[0]["pose_95_low"] < rows[0]["pose_95"] <= rows[0]["pose_95_high"]
    assert all(row["pose_95"] is None for row in rows[1:])
    assert "--tables movers --pairs 3" in table.command


def test_a_thing_that_crawls_makes_poses_surer_than_they_are(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(movers, "all_estimators", lambda: (FARPOINT,))
    monkeypatch.setattr(movers, "_SHARES", (0.0, 0.4))
    monkeypatch.setattr(movers, "_MOVES", {"1 px": partial(movers.with_mover, shift_px=1.0)})
    *_, table = movers.movers_table(BenchOptions(tables=("movers",), pairs=60), silent)
    names = [column.name for column in table.columns]
    still, crawling = (dict(zip(names, row, strict=True)) for row in table.rows)
    assert still["pose_95"] > 0.87
    assert crawling["pose_95"] < 0.7
