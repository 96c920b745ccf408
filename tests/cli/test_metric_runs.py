"""Hints of lengths on the command line: outputs in metres, contradictions on stderr."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli_kit import CommandLine, assert_refused, record_of, write_folder

from farpoint.sinks import read_motions
from farpoint.sinks.positions import read_positions
from farpoint.synthetic.sequence import RenderedSequence
from farpoint.trajectory.files import read_kitti, read_tum


@pytest.fixture
def shots(tmp_path: Path, images: tuple[np.ndarray, ...]) -> Path:
    return write_folder(tmp_path / "drive" / "images", images)


def steps_of(poses: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)


def test_a_speed_puts_every_file_in_metres(
    farpoint: CommandLine, tmp_path: Path, shots: Path, calibration: Path, drive: RenderedSequence
):
    out, table = tmp_path / "out", tmp_path / "wheels.csv"
    truth = steps_of(drive.world_from_cam)
    rows = "".join(f"{0.05 + 0.1 * k},{10.0 * step}\n" for k, step in enumerate(truth))
    table.write_text("timestamp,wheel\n" + rows)
    quick = ("--camera", calibration, "--out", out, "--no-overlay", "--no-report")
    measurements = ("--metric.speed", table, "--metric.speed-column", "wheel")
    outcome = farpoint("run", shots, *quick, *measurements)
    assert outcome.code == 0
    poses = read_tum(out / "trajectory.tum").world_from_body
    assert steps_of(poses).sum() == pytest.approx(truth.sum(), rel=0.02)
    np.testing.assert_allclose(steps_of(poses), truth, rtol=0.05)
    np.testing.assert_allclose(read_kitti(out / "trajectory.kitti").world_from_body, poses)
    positions = read_positions(out / "positions.csv")
    np.testing.assert_array_equal(positions.positions, poses[:, :3, 3])
    motions = read_motions(out / "motions.csv")
    # As known at their time, and as settled.
    np.testing.assert_allclose(motions.scale, steps_of(poses), rtol=0.02)
    assert (motions.scale_sigma > 0.02 * motions.scale).all()
    end = positions.positions[-1]
    along = end / np.linalg.norm(end)
    sigma = np.sqrt(along @ positions.covariances[-1][3:6, 3:6] @ along)
    assert 0.02 * np.linalg.norm(end) < sigma < 0.06 * np.linalg.norm(end)
    metric = record_of(out)["metric"]
    assert metric["unit"] == "m"
    assert metric["contradictions"] == []
    assert metric["metres_per_unit"]["first"] == pytest.approx(truth[0], rel=0.03)


def test_contradictions_are_reported(
    farpoint: CommandLine, tmp_path: Path, shots: Path, calibration: Path, drive: RenderedSequence
):
    places = drive.world_from_cam[:, :3, 3]
    table = tmp_path / "gnss.csv"
    rows = "".join(f"{0.1 * k},{x},{y},{z}\n" for k, (x, y, z) in enumerate(places))
    table.write_text("timestamp,x,y,z\n" + rows)
    out = tmp_path / "out"
    outcome = farpoint(
        *("run", shots, "--camera", calibration, "--out", out, "--no-overlay", "--no-report"),
        *("--metric.gnss", table, "--metric.gnss-sigma", "0.01"),
        *("--metric.distance", "2", "9", 1.5 * float(np.linalg.norm(places[9] - places[2]))),
    )
    assert outcome.code == 0
    assert "farpoint: distance: from 0.2 s to 0.9 s, lengths are 1.5" in outcome.err
    assert len(record_of(out)["metric"]["contradictions"]) == 1


def test_a_measurement_without_a_reading_leaves_the_unit(
    farpoint: CommandLine, tmp_path: Path, shots: Path, calibration: Path
):
    out = tmp_path / "out"
    quick = ("--camera", calibration, "--out", out, "--no-overlay", "--no-report")
    outcome = farpoint("run", shots, *quick, "--metric.distance", "3", "99", "5.0")
    assert outcome.code == 0
    assert "no aiding measurement gave a reading of the scale" in outcome.err
    assert read_motions(out / "motions.csv").scale[0] == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--metric.speed", "no-such.csv"], ["no-such.csv", "no such file"]),
        (["--metric.height", "-1.5"], ["height", "-1.5"]),
        (["--metric.speed-sigma", "0"], ["--metric.speed-sigma", "0"]),
        (["--metric.distance", "5", "3", "1.0"], ["frame0", "5 and 3"]),
    ],
)
def test_an_invalid_measurement_is_refused(
    farpoint: CommandLine, shots: Path, calibration: Path, arguments: list[str], words: list[str]
):
    assert_refused(farpoint("run", shots, "--camera", calibration, *arguments), *words)
