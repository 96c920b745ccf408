"""Two runs into one folder, a full disk, a killed process: one line, and what is there is valid."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import av
import numpy as np
import pytest
from cli_kit import (
    FARPOINT,
    PATIENCE_S,
    CommandLine,
    assert_refused,
    record_of,
    start,
    there_and_back,
    wait_for_rows,
    write_folder,
)

from farpoint.sinks import FolderLock
from farpoint.sinks.motions import read_motions
from farpoint.trajectory.files import read_tum

Pictures = tuple[np.ndarray, ...]


@pytest.fixture
def long_drive(tmp_path: Path, images: Pictures) -> Path:
    return write_folder(tmp_path / "shots", 20 * there_and_back(images))


def test_a_second_run_into_a_folder_is_refused_and_the_first_goes_on(
    tmp_path: Path, long_drive: Path, calibration: Path, farpoint: CommandLine
):
    out = tmp_path / "out"
    arguments = ("run", long_drive, "--camera", calibration, "--out", out)
    process = start(*arguments, "--no-overlay", "--no-report")
    wait_for_rows(out / "motions.csv", 5, process)
    (out / "drive.rrd").write_text("recorded by the first")
    told = farpoint(*arguments, "--rrd", out / "drive.rrd")
    assert_refused(told, out, "another run is writing into this folder")
    assert (out / "drive.rrd").read_text() == "recorded by the first"
    assert_refused(farpoint("demo", "--out", out), out, "another run")
    assert farpoint("evaluate", out).code == 0
    os.killpg(process.pid, signal.SIGINT)
    process.communicate(timeout=PATIENCE_S)
    assert record_of(out)["state"] == "interrupted"
    assert len(read_motions(out / "motions.csv")) > 5


def test_the_demo_holds_its_folder_to_the_end(
    tmp_path: Path, farpoint: CommandLine, monkeypatch: pytest.MonkeyPatch
):
    def evaluate(folder: Path, truth: Path) -> None:
        assert truth.parent == folder
        with pytest.raises(ValueError, match="another run"):
            FolderLock(folder)
        raise KeyboardInterrupt

    monkeypatch.setattr("farpoint.cli.demo.evaluate_folder", evaluate)
    outcome = farpoint("demo", "--out", tmp_path, "--frames", "3", "--no-overlay", "--no-report")
    assert outcome.code == 130
    FolderLock(tmp_path).release()


@pytest.mark.skipif(sys.platform == "win32", reason="limits of POSIX")
@pytest.mark.parametrize("limit", [2000, 100_000])
def test_a_full_disk_is_one_line_and_a_failed_run(
    limit: int, tmp_path: Path, long_drive: Path, calibration: Path
):
    import resource

    out = tmp_path / "out"
    command = [*FARPOINT, "run", str(long_drive), "--camera", str(calibration), "--out", str(out)]
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        check=False,
        timeout=PATIENCE_S,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    told = [line for line in done.stderr.splitlines() if " frames, " not in line]
    assert (done.returncode, len(told)) == (2, 1), done.stderr
    assert "cannot be written: File too large" in told[0]
    if limit > 2000:  # room for the record
        record = record_of(out)
        assert record["state"] == "failed"
        assert record["error"] == told[0].replace("farpoint: ", "InputError: ")
        assert read_motions(out / "motions.csv")
        assert read_tum(out / "trajectory.tum")


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks for processes in /proc")
def test_the_death_of_the_process_that_draws_is_one_line(
    tmp_path: Path, long_drive: Path, calibration: Path
):
    out = tmp_path / "out"
    process = start("run", long_drive, "--camera", calibration, "--out", out, "--no-report")
    wait_for_rows(out / "motions.csv", 30, process)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    for child in children.read_text().split():
        os.kill(int(child), signal.SIGKILL)
    said, told = process.communicate(timeout=PATIENCE_S)
    told = [line for line in told.splitlines() if " frames, " not in line]
    assert (process.returncode, said, len(told)) == (2, "", 1)
    assert f"{out / 'overlay.mp4'}: the process that draws it has ended early" in told[0]
    record = record_of(out)
    assert (record["state"], "overlay.mp4" in record["error"]) == ("failed", True)
    assert len(read_motions(out / "motions.csv")) >= 30
    with av.open(str(out / "overlay.mp4")) as film:
        assert sum(1 for _ in film.decode(video=0)) > 0
