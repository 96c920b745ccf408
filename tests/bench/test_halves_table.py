"""The table of halves of the tracks of real images."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bench_kit import silent

from farpoint import Odometry, OdometryOptions, load_camera, open_frames
from farpoint.bench.options import BenchOptions
from farpoint.bench.run import run_bench
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


def test_a_row_is_the_split_half_test_of_its_runs(folder: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(halves, "_RUNS", 2)
    options = BenchOptions(tables=("halves",), data=(folder,), seed=3)
    (table,) = halves.halves_table(options, silent)
    row = dict(zip((column.name for column in table.columns), table.rows[0], strict=True))
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


def test_without_sequences_the_table_says_what_is_missing(tmp_path: Path):
    options = BenchOptions(tables=("halves",), data=(tmp_path,))
    (reason,) = run_bench(options, tmp_path / "out", silent, show=silent).skipped
    assert reason == "halves: skipped, --data names no image sequences with a calibration"
