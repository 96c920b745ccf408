"""Wrong usage and unreadable input: exit code 2 and one line that names the file and the field."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from cli_kit import (
    CALIBRATION,
    NOT_AN_IMAGE,
    CommandLine,
    assert_refused,
    encoded,
    quick_run,
    write_folder,
    write_video,
)

Pictures = tuple[np.ndarray, ...]


@pytest.fixture
def shots(tmp_path: Path, images: Pictures) -> Path:
    return write_folder(tmp_path / "shots", images[:2])


def missing(path: Path) -> None:
    assert not path.exists()


def empty(path: Path) -> None:
    path.touch()


def text(path: Path) -> None:
    path.write_text("a text of more than one line\nthat is called a video\n")


def truncated_head(path: Path) -> None:
    """An MP4 keeps at its end what is needed to read it."""
    write_video(path, [np.full((144, 240), 90, np.uint8)] * 5)
    path.write_bytes(path.read_bytes()[:-200])


@pytest.mark.parametrize(
    ("make", "problem"),
    [
        (missing, "no such file"),
        (empty, "cannot be opened as a video"),
        (text, "video"),
        (truncated_head, "truncated"),
    ],
)
def test_a_video_that_cannot_be_read(
    farpoint: CommandLine,
    tmp_path: Path,
    calibration: Path,
    make: Callable[[Path], None],
    problem: str,
):
    video, out = tmp_path / "drive.mp4", tmp_path / "out"
    make(video)
    assert_refused(
        farpoint("run", video, "--camera", calibration, "--out", out), f"{video}: ", problem
    )
    assert not out.exists()


@pytest.mark.parametrize(
    ("files", "problem"),
    [
        ({}, "holds no images"),
        ({"notes.txt": b"none here"}, "holds no images"),
        ({"0.png": NOT_AN_IMAGE, "1.png": b""}, "holds no image that can be decoded"),
        ({"left/0.png": NOT_AN_IMAGE, "right/0.png": NOT_AN_IMAGE}, "several folders"),
    ],
)
def test_a_folder_without_images(
    farpoint: CommandLine,
    tmp_path: Path,
    calibration: Path,
    files: dict[str, bytes],
    problem: str,
):
    folder = tmp_path / "shots"
    folder.mkdir()
    for name, data in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(data)
    arguments = ("--camera", calibration, "--out", tmp_path / "out")
    assert_refused(farpoint("run", folder, *arguments), f"{folder}: ", problem)


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("nothing*.png", ["nothing*.png", "matches no images"]),
        ("gopher://host/drive", ["gopher://host/drive", "unknown kind of stream"]),
        ("0.png", ["0.png", "is one image"]),
    ],
)
def test_other_sources_that_are_none(
    farpoint: CommandLine,
    tmp_path: Path,
    images: Pictures,
    calibration: Path,
    monkeypatch: pytest.MonkeyPatch,
    source: str,
    words: list[str],
):
    monkeypatch.chdir(tmp_path)
    Path("0.png").write_bytes(encoded(images[0]))
    assert_refused(farpoint("run", source, "--camera", calibration), *words)
    assert not Path("farpoint-out").exists()


def changed(old: str, new: str) -> bytes:
    assert old in CALIBRATION
    return CALIBRATION.replace(old, new).encode()


CALIBRATION_FAULTS = {
    "empty": (b"", ["empty"]),
    "binary": (bytes(range(256)), ["is not a camera calibration"]),
    "prose": (b"focal length: long\n", ["expected"]),
    "malformed": (changed("[240, 144]", "[240, 144"), ["line"]),
    "without-a-field": (changed("intrinsics", "intrinsic"), ["intrinsics", "missing"]),
    "negative": (changed("[180.0", "[-180.0"), ["intrinsics", "-180"]),
    "zero": (changed("[180.0", "[0.0"), ["intrinsics", "fx"]),
    "nan": (changed("119.5", ".nan"), ["intrinsics", "nan"]),
    "infinite": (changed("119.5", ".inf"), ["intrinsics", "inf"]),
    "word": (changed("119.5", "wide"), ["intrinsics", "wide"]),
    "too-few": (changed(", 71.5", ""), ["intrinsics", "4"]),
    "nan-distortion": (changed("[0.0", "[.nan"), ["distortion_coefficients", "nan"]),
    "negative-size": (changed("[240", "[-240"), ["resolution", "-240"]),
    "unknown-lens": (changed("pinhole", "kaleidoscope"), ["camera_model", "kaleidoscope"]),
}


@pytest.mark.parametrize("command", ["run", "camera"])
@pytest.mark.parametrize("fault", CALIBRATION_FAULTS)
def test_a_calibration_that_cannot_be_used(
    farpoint: CommandLine, tmp_path: Path, shots: Path, command: str, fault: str
):
    data, words = CALIBRATION_FAULTS[fault]
    path, out = tmp_path / "sensor.yaml", tmp_path / "out"
    path.write_bytes(data)
    run = ("run", shots, "--camera", path, "--out", out)
    assert_refused(farpoint(*(run if command == "run" else ("camera", path))), f"{path}: ", *words)
    assert not out.exists()


def test_a_calibration_that_is_not_there(farpoint: CommandLine, tmp_path: Path, shots: Path):
    nowhere = tmp_path / "nowhere.yaml"
    assert_refused(farpoint("run", shots, "--camera", nowhere), f"{nowhere}: ", "no such file")
    assert_refused(farpoint("run", shots, "--camera", tmp_path), f"{tmp_path}: ")


def test_a_missing_calibration_is_looked_for_beside_the_images(
    farpoint: CommandLine, tmp_path: Path, shots: Path
):
    assert_refused(farpoint("run", shots), f"{shots}: --camera: missing")
    beside = shots / "sensor.yaml"
    beside.write_text(CALIBRATION)
    assert_refused(farpoint("run", shots), f"{shots}: --camera: missing", beside)
    assert_refused(farpoint("run", tmp_path / "nowhere"), "no such file or folder")


@pytest.mark.parametrize("leading_fault", [False, True])
def test_a_calibration_for_another_image_size(
    farpoint: CommandLine, tmp_path: Path, images: Pictures, leading_fault: bool
):
    shots = write_folder(tmp_path / "shots", [*[NOT_AN_IMAGE] * leading_fault, *images[:2]])
    path = tmp_path / "sensor.yaml"
    path.write_bytes(changed("[240, 144]", "[752, 480]"))
    assert_refused(
        farpoint("run", shots, "--camera", path, "--out", tmp_path / "out"),
        f"{path}: image size: ",
        "240x144",
        "752x480",
    )


def test_a_wrong_calibration_costs_no_earlier_result(
    farpoint: CommandLine, tmp_path: Path, shots: Path, calibration: Path
):
    out = tmp_path / "out"
    arguments = ("run", shots, "--camera", calibration, "--out", out, "--no-overlay")
    assert farpoint(*arguments).code == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    calibration.write_bytes(changed("[240, 144]", "[752, 480]"))
    assert_refused(farpoint(*arguments), calibration)
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


@pytest.mark.parametrize("blocked", ["out", "out/deeper", "motions.csv", "overlay.mp4"])
def test_outputs_that_cannot_be_written(
    farpoint: CommandLine, tmp_path: Path, shots: Path, calibration: Path, blocked: str
):
    """What also stops root: a file where a folder should be, a folder where a file should be."""
    out = tmp_path / "out"
    if blocked.startswith("out"):
        out.write_text("in the way")
        out = tmp_path / blocked
    else:
        (out / blocked / "in the way").mkdir(parents=True)
    assert_refused(
        farpoint("run", shots, "--camera", calibration, "--out", out), out, "cannot be written"
    )


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission(
    farpoint: CommandLine, tmp_path: Path, shots: Path, calibration: Path
):
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o500)
    assert_refused(
        farpoint("run", shots, "--camera", calibration, "--out", closed / "out"),
        closed / "out",
        "Permission denied",
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["bogus"], ["bogus"]),
        (["--bogus"], ["--bogus"]),
        (["run"], ["SOURCE", "run --help"]),
        (["run", "x", "--camra", "y"], ["--camra"]),
        (["run", "x", "--camera"], ["--camera"]),
        (["run", "x", "--camera", "y", "--seed", "one"], ["--seed", "one"]),
        (["run", "x", "--camera", "y", "--tracker.max-tracks", "0"], ["--tracker.max-tracks: "]),
        (
            ["run", "x", "--camera", "y", "--tracker.matching.window-px", "12"],
            ["--tracker.matching.window-px: ", "odd", "12"],
        ),
        (
            ["run", "x", "--camera", "y", "--tracker.matching.window-px", "100001"],
            ["--tracker.matching.window-px: ", "5 to 255"],
        ),
        (["run", "x", "--camera", "y", "--pose.confidence", "2"], ["--pose.confidence: "]),
        (["run", "x", "--camera", "y", "--pose.confidence", "nan"], ["--pose.confidence: "]),
        (["evaluate"], ["DIR", "evaluate --help"]),
        (["evaluate", "x", "--truth", "y", "--delta-frames", "0"], ["delta", "0"]),
        (["camera"], ["CALIB", "camera --help"]),
        (["demo", "--frames", "2"], ["frames", "2"]),
        (["demo", "--seed", "-1"], ["seed", "-1"]),
    ],
)
def test_wrong_usage(farpoint: CommandLine, arguments: list[str], words: list[str]):
    assert_refused(farpoint(*arguments), *words)


def test_wrong_usage_where_the_terminal_knows_no_rules_of_boxes():
    """Its words, without the dashes that stand for a box."""
    arguments = ["run", "x", "--tracker.max-tracks", "0"]
    said = subprocess.run(
        [sys.executable, "-m", "farpoint", *arguments],
        env={**os.environ, "PYTHONIOENCODING": "ascii", "LC_ALL": "C"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert said.returncode == 2
    assert said.stderr.startswith("farpoint: --tracker.max-tracks: expected")
    assert said.stderr.count("\n") == 1


@pytest.mark.parametrize("fps", ["0", "-1", "nan", "inf"])
def test_a_frame_rate_that_is_none(farpoint: CommandLine, shots: Path, calibration: Path, fps: str):
    assert_refused(farpoint("run", shots, "--camera", calibration, "--fps", fps), "fps", fps)


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory, images: Pictures) -> Path:
    return quick_run(tmp_path_factory.mktemp("run"), images[:2])


@pytest.fixture
def finished(tmp_path: Path, result: Path) -> Path:
    return shutil.copytree(result, tmp_path / "finished")


@pytest.mark.parametrize(
    ("truth", "problem"),
    [
        (None, "no such file"),
        ("", "expected"),
        ("0 0 0 0 0 0 0\n", "8"),
        ("900 0 0 0 0 0 0 1\n901 0 0 0 0 0 0 1\n", "900"),
        ("0 nan 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n", "line 1: expected finite"),
    ],
    ids=["missing", "empty", "columns", "other-times", "nan"],
)
def test_a_truth_that_cannot_be_used(
    farpoint: CommandLine, tmp_path: Path, finished: Path, truth: str | None, problem: str
):
    path = tmp_path / "truth.tum"
    if truth is not None:
        path.write_text(truth)
    assert_refused(farpoint("evaluate", finished, "--truth", path), f"{path}: ", problem)


def test_a_run_that_cannot_be_evaluated(farpoint: CommandLine, tmp_path: Path, finished: Path):
    truth = finished / "trajectory.tum"
    assert_refused(
        farpoint("evaluate", tmp_path / "nowhere", "--truth", truth), tmp_path / "nowhere"
    )
    pairs = tmp_path / "nowhere" / "pairs.csv"
    assert_refused(
        farpoint("evaluate", finished, "--truth", truth, "--pairs", pairs),
        f"{pairs}: cannot be written",
    )
    motions = finished / "motions.csv"
    motions.write_text(motions.read_text().replace(",OK,", ",FINE,"))
    assert_refused(
        farpoint("evaluate", finished, "--truth", truth), f"{motions}: line 2, column status"
    )


def test_an_unforeseen_error_of_the_system_is_one_line(
    farpoint: CommandLine, calibration: Path, monkeypatch: pytest.MonkeyPatch
):
    def fail(_self: object) -> None:
        raise OSError(28, "No space left on device", "motions.csv")

    monkeypatch.setattr("farpoint.cli.camera.ShowCamera.__call__", fail)
    assert_refused(farpoint("camera", calibration), "motions.csv: No space left on device")
