"""The table of real images that are frames apart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bench_kit import silent

from farpoint.bench.options import BenchOptions
from farpoint.bench.run import run_bench
from farpoint.bench.sequences import find_sequences, posed_sequence
from farpoint.bench.tables import steps
from farpoint.camera import Camera
from farpoint.synthetic.sequence import render_drive

CAMERA = Camera.pinhole(400, 200, 240.0, 240.0, 199.5, 99.5)
FRAMES, LAST = 6, 5


@pytest.fixture
def drive(tmp_path: Path):
    """A rendered drive, and a folder with its images, calibration and all poses but the last."""
    cv2 = pytest.importorskip("cv2")
    rendered = render_drive(CAMERA, frames=FRAMES, seed=1)
    folder = tmp_path / "drive"
    (folder / "images").mkdir(parents=True)
    for frame in rendered:
        cv2.imwrite(str(folder / "images" / f"{frame.index:06}.png"), frame.image)
    (folder / "calib.txt").write_text("P0: 240 0 199.5 0 0 240 99.5 0 0 0 1 0\n")
    world_from_cam = [np.linalg.inv(rendered.cam1_from_cam0(0, k))[:3] for k in range(LAST)]
    np.savetxt(folder / "poses.txt", np.reshape(world_from_cam, (LAST, 12)))
    return rendered, folder


def test_a_sequence_has_the_images_with_known_poses(drive):
    rendered, folder = drive
    (sequence,) = find_sequences((folder,))
    recording = posed_sequence(sequence)
    assert recording is not None
    assert len(recording.images) == len(recording.world_from_cam) == LAST
    assert recording.camera.size == CAMERA.size
    np.testing.assert_allclose(
        recording.cam1_from_cam0(1, 3), rendered.cam1_from_cam0(1, 3), atol=1e-12
    )
    (folder / "poses.txt").unlink()
    assert posed_sequence(sequence) is None


def test_every_kind_and_step_has_a_row_for_every_estimator(drive, monkeypatch):
    monkeypatch.setattr(steps, "_STEPS", (1, 4, FRAMES))
    _, folder = drive
    options = BenchOptions(tables=("steps",), pairs=2, data=(folder,))
    tables = list(steps.steps_table(options, silent))
    first, *_, table = (table for table in tables if table.name == "steps")
    assert tables[-1].name == "steps_summary"
    assert len(first.rows) == len(table.rows) / 4
    names = [column.name for column in table.columns]
    rows = [dict(zip(names, row, strict=True)) for row in table.rows]
    ours = [row for row in rows if row["estimator"] == "farpoint"]
    # No two images are six frames apart, one pair is four.
    assert [(row["kind"], row["step"], row["pairs"]) for row in ours] == [
        ("Lucas-Kanade", 1, 2),
        ("Lucas-Kanade", 4, 1),
        ("SIFT", 1, 2),
        ("SIFT", 4, 1),
    ]
    for row in ours:
        assert row["sequence"] == "drive"
        assert row["matches"] > 30
        assert row["rotation_mean_deg"] < 0.5
        assert row["direction_mean_deg"] < 10.0


def test_without_sequences_the_table_is_skipped(tmp_path: Path):
    report = run_bench(BenchOptions(tables=("steps",)), tmp_path, silent, show=silent)
    assert not report.tables
    (reason,) = report.skipped
    assert reason.endswith("--data names no image sequences with a calibration and true poses")
