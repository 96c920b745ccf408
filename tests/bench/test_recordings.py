"""The table of paths over recordings with their truth."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from bench_kit import silent

from farpoint.bench.options import BenchOptions
from farpoint.bench.run import run_bench
from farpoint.bench.sequences import find_sequences, recorded
from farpoint.camera import Camera
from farpoint.synthetic.sequence import render_drive
from farpoint.trajectory.files import Trajectory, write_tum

CAMERA = Camera.pinhole(320, 240, 220.0, 220.0, 159.5, 119.5)
FRAMES = 14


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory):
    """A rendered drive, and a folder with its images and calibration, without truth."""
    cv2 = pytest.importorskip("cv2")
    rendered = render_drive(CAMERA, frames=FRAMES, seed=1)
    folder = tmp_path_factory.mktemp("data") / "drive"
    (folder / "images").mkdir(parents=True)
    for frame in rendered:
        cv2.imwrite(str(folder / "images" / f"{frame.index:06}.png"), frame.image)
    (folder / "calib.txt").write_text("P0: 220 0 159.5 0 0 220 119.5 0 0 0 1 0\n")
    return rendered, folder


@pytest.fixture
def truth(drive) -> Iterator[Path]:
    rendered, folder = drive
    file = folder / "poses.txt"
    np.savetxt(file, np.reshape(rendered.world_from_cam[:, :3], (FRAMES, 12)))
    yield file
    file.unlink()


@pytest.mark.usefixtures("truth")
def test_a_recording_has_a_row_with_its_errors_and_its_lens(drive, tmp_path: Path):
    rendered, folder = drive
    options = BenchOptions(tables=("path",), data=(folder.parent,))
    (table,) = run_bench(options, tmp_path, silent, show=silent).tables
    names = [column.name for column in table.columns]
    row, together = (dict(zip(names, cells, strict=True)) for cells in table.rows)
    steps = np.diff(rendered.world_from_cam[:, :3, 3], axis=0)
    assert (row["sequence"], row["frames"], row["breaks"]) == ("drive", FRAMES, 0)
    assert row["path_m"] == pytest.approx(np.sum(np.linalg.norm(steps, axis=1)))
    assert 0.0 < row["ate_m"] < 0.05 * row["path_m"]
    assert row["focal_given_px"] == 220.0
    assert 0.0 < row["focal_sigma_px"] < 10.0
    assert row["path_ms"] > 0.0
    # One recording together is that recording.
    assert together["lengths_10"] == row["lengths_10"] is not None
    assert "--tables path --seed 0 --data" in table.command


def test_without_truth_there_is_no_recording(drive, tmp_path: Path):
    _, folder = drive
    options = BenchOptions(tables=("path",), data=(folder,))
    report = run_bench(options, tmp_path, silent, show=silent)
    assert report.skipped == ("path: skipped, --data names no image sequences with true poses",)


def test_truth_with_a_pose_for_each_frame_needs_no_times(drive):
    rendered, folder = drive
    (sequence,) = find_sequences((folder,))
    turns = rendered.world_from_cam.copy()
    turns[:, :3, 3] = 0.0
    times = 1e9 + np.arange(FRAMES) / 30.0
    write_tum(folder / "truth.tum", Trajectory(timestamps=times, world_from_body=turns))
    recording = recorded(sequence)
    (folder / "truth.tum").unlink()
    assert recording is not None
    assert len(recording.frames) == FRAMES
    np.testing.assert_allclose(recording.world_from_cam, turns, atol=1e-8)
