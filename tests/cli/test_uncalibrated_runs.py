"""Runs without a calibration: a guess, said aloud, in whose covariances one can believe."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from cli_kit import (
    FOCAL,
    NOT_AN_IMAGE,
    WIDTH,
    CommandLine,
    assert_refused,
    record_of,
    write_folder,
    write_phone_pictures,
)

from farpoint.sinks.motions import read_motions

FIELD_DEG = math.degrees(2.0 * math.atan(WIDTH / 2.0 / FOCAL))

Pictures = tuple[np.ndarray, ...]


@pytest.fixture
def shots(tmp_path: Path, images: Pictures) -> Path:
    return write_folder(tmp_path / "shots", images[:5])


def test_a_field_of_view_gives_the_calibrated_motions_with_larger_covariances(
    farpoint: CommandLine, tmp_path: Path, shots: Path, calibration: Path
):
    quick = ("--no-overlay", "--out")
    farpoint("run", shots, "--camera", calibration, *quick, tmp_path / "a")
    outcome = farpoint("run", shots, "--fov", str(FIELD_DEG), *quick, tmp_path / "b")
    assert outcome.code == 0
    said = outcome.err.splitlines()[0]
    assert said.startswith("farpoint: Not calibrated: the camera is a guess: a field of view of 67")
    assert said.removeprefix("farpoint: ") in record_of(tmp_path / "b")["notes"]
    assert "Not calibrated" in (tmp_path / "b" / "report.html").read_text()
    assert "Not calibrated" not in (tmp_path / "a" / "report.html").read_text()
    exact, guessed = (read_motions(tmp_path / name / "motions.csv") for name in "ab")
    np.testing.assert_allclose(guessed.quat_xyzw, exact.quat_xyzw, rtol=0.0, atol=1e-12)
    wider = guessed.covariance - exact.covariance
    assert (np.linalg.eigvalsh(wider) > -1e-12).all()
    assert (np.trace(guessed.covariance, axis1=1, axis2=2).min()) > 2.0 * np.trace(
        exact.covariance, axis1=1, axis2=2
    ).min()


def test_auto_takes_what_exif_tells(farpoint: CommandLine, tmp_path: Path, images: Pictures):
    folder, out = write_phone_pictures(tmp_path / "phone", images[:3], 28), tmp_path / "out"
    outcome = farpoint("run", folder, "--camera", "auto", "--out", out, "--no-overlay")
    assert outcome.code == 0
    assert "28 mm in 35 mm equivalents, from EXIF" in outcome.err.splitlines()[0]
    expected = 28.0 / math.hypot(36.0, 24.0) * math.hypot(*images[0].shape)
    assert record_of(out)["camera"]["parameters"]["fx"] == pytest.approx(expected)


def test_a_first_image_that_cannot_be_decoded_does_not_matter(
    farpoint: CommandLine, tmp_path: Path, images: Pictures
):
    folder = write_folder(tmp_path / "shots", [NOT_AN_IMAGE, *images[:3]])
    out = tmp_path / "out"
    outcome = farpoint("run", folder, "--fov", "67", "--out", out, "--no-overlay", "--no-report")
    assert outcome.code == 0
    assert record_of(out)["camera"]["size"] == list(images[0].shape[::-1])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--fov", "195"], ["--fov: expected 1 to 150 degrees, got 195", "calibration"]),
        (["--fov", "0"], ["--fov: expected 1 to 150 degrees"]),
        (["--fov", "60", "--camera", "auto"], ["--fov: ", "--camera", "not both"]),
        (["--camera", "auto"], ["--camera: EXIF of 000000.png has no", "--fov DEG"]),
        ([], ["--camera: missing", "--fov DEG"]),
    ],
)
def test_guesses_that_cannot_be_made(
    farpoint: CommandLine, tmp_path: Path, shots: Path, arguments: list[str], words: list[str]
):
    out = tmp_path / "out"
    assert_refused(farpoint("run", shots, *arguments, "--out", out), *words)
    assert not out.exists()
