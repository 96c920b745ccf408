"""The command as a process of its own: signals, pipes, exit codes."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from pathlib import Path

import av
import numpy as np
import pytest
from cli_kit import (
    BUFFERED,
    FARPOINT,
    PATIENCE_S,
    record_of,
    start,
    there_and_back,
    wait_for_rows,
    write_folder,
)

from farpoint.sinks.background import WAITING
from farpoint.sinks.motions import read_motions
from farpoint.trajectory.files import read_tum

Pictures = tuple[np.ndarray, ...]


def test_ctrl_c_leaves_valid_files(tmp_path: Path, images: Pictures, calibration: Path):
    """It goes to every process of the terminal's group: not to the one that draws the film."""
    shots, out = write_folder(tmp_path / "shots", 40 * there_and_back(images)), tmp_path / "out"
    process = start("run", shots, "--camera", calibration, "--out", out)
    wait_for_rows(out / "motions.csv", 5, process)
    os.killpg(process.pid, signal.SIGINT)
    said, told = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert said == ""
    assert told.splitlines()[-1] == "farpoint: interrupted; what was computed is in the outputs"
    assert "Traceback" not in told
    record = record_of(out)
    assert record["state"] == "interrupted"
    motions, poses = read_motions(out / "motions.csv"), read_tum(out / "trajectory.tum")
    assert 5 <= len(motions) < len(list(shots.iterdir())) - 1
    # A frame in hand when the signal came may be in one file and not in the next.
    assert 0 <= len(motions) - sum(record["pairs"].values()) <= 1
    assert 0 <= len(motions) - (len(poses) - 1) <= 1
    with av.open(str(out / "overlay.mp4")) as film:
        assert sum(1 for _ in film.decode(video=0)) >= len(motions)
    report = (out / "report.html").read_text()
    assert report.rstrip().endswith("</html>")
    assert "interrupted" in report


def test_a_killed_run_leaves_a_finished_video_and_no_process(
    tmp_path: Path, images: Pictures, calibration: Path
):
    shots, out = write_folder(tmp_path / "shots", 40 * there_and_back(images)), tmp_path / "out"
    process = start("run", shots, "--camera", calibration, "--out", out)
    wait_for_rows(out / "motions.csv", 20, process)
    process.kill()
    process.communicate(timeout=PATIENCE_S)
    # Nobody is left in the group that would hold the film open.
    end = time.monotonic() + PATIENCE_S
    film = out / "overlay.mp4"
    while b"moof" in (data := film.read_bytes()) or b"moov" not in data:
        assert time.monotonic() < end
        time.sleep(0.02)
    with av.open(str(film)) as pictures:
        drawn = sum(1 for _ in pictures.decode(video=0))
    rows = len(read_motions(out / "motions.csv"))
    assert rows - WAITING <= drawn <= rows + 1
    assert read_tum(out / "trajectory.tum")
    assert record_of(out)["state"] == "running"


def run_printing_to(stdout: int, *arguments: str | Path) -> tuple[int, str]:
    """Exit code and stderr of a command that prints to an open file."""
    command = [*FARPOINT, *map(str, arguments)]
    done = subprocess.run(
        command, stdout=stdout, stderr=subprocess.PIPE, text=True, env=BUFFERED, check=False
    )
    return done.returncode, done.stderr


@pytest.mark.parametrize("arguments", [["camera", "--help"], ["camera", "CALIB"]])
def test_a_reader_that_has_seen_enough_is_no_fault(calibration: Path, arguments: list[str]):
    reader, writer = os.pipe()
    os.close(reader)
    arguments = [str(calibration) if word == "CALIB" else word for word in arguments]
    assert run_printing_to(writer, *arguments) == (0, "")
    os.close(writer)


def test_results_that_cannot_be_printed_are_one_line(calibration: Path):
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("no /dev/full on this system")
    with full.open("w") as nowhere:
        told = run_printing_to(nowhere.fileno(), "camera", calibration)
    assert told == (2, "farpoint: No space left on device\n")


@pytest.mark.parametrize("arguments", [[], ["camera", "nowhere.yaml"], ["evaluate", "nowhere"]])
def test_a_full_disk_behind_standard_error_changes_no_exit_code(arguments: list[str]):
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("no /dev/full on this system")
    with full.open("w") as nowhere:
        done = subprocess.run([*FARPOINT, *arguments], stderr=nowhere, env=BUFFERED, check=False)
    assert done.returncode == 2


def test_a_full_disk_behind_the_log_of_a_run_is_no_end_of_it(
    tmp_path: Path, images: Pictures, calibration: Path
):
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("no /dev/full on this system")
    shots, out = write_folder(tmp_path / "shots", images[:4]), tmp_path / "out"
    options = ("--camera", calibration, "--out", out, "--no-report", "--no-overlay")
    with full.open("w") as nowhere:
        done = subprocess.run(
            [*FARPOINT, "run", *map(str, (shots, *options))], stderr=nowhere, check=False
        )
    assert done.returncode == 0
    assert record_of(out)["state"] == "done"
