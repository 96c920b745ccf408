"""The table of halves of the tracks of real images."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench_kit import silent

from farpoint import Odometry, OdometryOptions, load_camera, open_frames
from farpoint.bench.options import BenchOptions
from farpoint.bench.run import run_bench
from farpoint.bench.table import Table
from farpoint.bench.tables import halves
from farpoint.camera import Camera
from farpoint.metrics import evaluate_halves
from farpoint.synthetic.sequence import render_drive

FRAMES = 6


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    cv2 = pytest.importorskip("cv2")
    for frame in render_drive(Camera.pinhole(400, 200, 240.0, 240.0, 199.5, 99.5), frames=FRAMES):
        cv2.imwrite(str(tmp_path / f"{frame.index:06}.png"), frame.image)
    (tmp_path / "calib.txt").write_text("P0: 240 0 199.5 0 0 240 99.5 0 0 0 1 0\n")
    return tmp_path


@pytest.fixture
def tables(folder: Path, monkeypatch: pytest.MonkeyPatch) -> list[Table]:
    """Of two runs over the folder, seeds 3 and 4."""
    monkeypatch.setattr(halves, "_RUNS", 2)
    options = BenchOptions(tables=("halves",), data=(folder,), seed=3)
    return list(halves.halves_table(options, silent))


def rows_of(table: Table) -> list[dict[str, Any]]:
    return [
        dict(zip((column.name for column in table.columns), row, strict=True)) for row in table.rows
    ]


def test_a_row_is_the_split_half_test_of_its_runs(folder: Path, tables: list[Table]):
    [row] = rows_of(tables[0])
    alone, tests = [], []
    for seed in (3, 4):
        odometry = Odometry(load_camera(folder / "calib.txt"), OdometryOptions(seed=seed))
        run = [odometry.split_half(r) for r in odometry.run(open_frames(folder)) if r.pose]
        alone.append(evaluate_halves(run).ratio.ratio)
        tests += run
    assert (row["runs"], row["pairs"], row["in_pose"]) == (2, 2 * (FRAMES - 1), 2 * (FRAMES - 1))
    assert (row["lowest_run"], row["highest_run"]) == (min(alone), max(alone))
    assert row["ratio"] == evaluate_halves(tests).ratio.ratio
    assert min(alone) < row["ratio"] < max(alone)
    assert row["pose_95"] == np.mean([test.nees <= 11.07 for test in tests])


def test_the_same_runs_are_split_by_cells_too(folder: Path, tables: list[Table]):
    by_patches, by_cells = tables
    assert (by_cells.name, by_cells.command) == ("halves_by_cells", by_patches.command)
    rows = rows_of(by_cells)
    assert [row["split_by"] for row in rows] == ["parts", "cells of 64 px", "cells of 128 px"]
    for row, cell_px in zip(rows, (None, 64.0, 128.0), strict=True):
        tests = []
        for seed in (3, 4):
            odometry = Odometry(load_camera(folder / "calib.txt"), OdometryOptions(seed=seed))
            results = odometry.run(open_frames(folder))
            tests += [odometry.split_half(r, cell_px=cell_px) for r in results if r.pose]
        found = evaluate_halves(tests)
        assert (row["sequence"], row["runs"], row["pairs"]) == (folder.name, 2, 2 * (FRAMES - 1))
        assert (row["compared"], row["ratio"]) == (found.compared, found.ratio.ratio)
        assert row["sigma_over_error"] == found.pose.sigma_over_error
        squares = np.array([test.nees for test in tests if test.dof == 5])
        assert row["pose_68"] == np.mean(squares <= 5.861)
        assert row["pose_95"] == np.mean(squares <= 11.07)
    assert len({row["ratio"] for row in rows}) == 3
    assert rows[0]["ratio"] == rows_of(by_patches)[0]["ratio"]


def test_without_sequences_the_table_says_what_is_missing(tmp_path: Path):
    options = BenchOptions(tables=("halves",), data=(tmp_path,))
    (reason,) = run_bench(options, tmp_path / "out", silent, show=silent).skipped
    assert reason == "halves: skipped, --data names no image sequences with a calibration"
