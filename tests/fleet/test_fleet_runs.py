"""A fleet whose workers are killed and which is interrupted: every drive once and whole."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest
from cli_kit import PATIENCE_S, write_folder
from fleet_kit import finished, rows_of_fleet, start_fleet, write_drives

DRIVES = 6


def wait_for_finished(out: Path, count: int, process) -> None:
    end = time.monotonic() + PATIENCE_S
    while len(finished(out)) < count:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.05)


def workers_of(pid: int) -> list[int]:
    children = [
        int(child)
        for thread in Path(f"/proc/{pid}/task").glob("*/children")
        for child in thread.read_text().split()
    ]
    return [c for c in children if b"spawn_main" in Path(f"/proc/{c}/cmdline").read_bytes()]


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="looks for workers in /proc")
def test_every_drive_once_whatever_happens(tmp_path: Path, shots: Path):
    drives, out = write_drives(tmp_path / "in", shots, DRIVES), tmp_path / "out"
    write_folder(drives / "drive-broken", [b"no image"])

    process = start_fleet(drives, out)
    wait_for_finished(out, 1, process)
    os.kill(workers_of(process.pid)[0], signal.SIGKILL)
    wait_for_finished(out, 3, process)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers, too
    said, told = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130, told
    assert "Traceback" not in told, told
    assert said == ""
    before = finished(out)
    states = [row["state"] for row in rows_of_fleet(out).values()]
    assert len(states) == DRIVES + 1
    assert states.count("done") == len(before) < DRIVES

    process = start_fleet(drives, out)
    said, told = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1, told
    assert "Traceback" not in told
    after = finished(out)
    assert len(after) == DRIVES
    assert {name: after[name] for name in before} == before  # none was run again
    rows = rows_of_fleet(out)
    broken = rows.pop("drive-broken")
    assert broken["state"] == "failed"
    assert "no image" in broken["error"]
    assert {row["state"] for row in rows.values()} == {"done"}
    assert {row["ok"] for row in rows.values()} == {"5"}
    # Nothing is left of what was killed, and equal drives have equal motions.
    assert {p.name for p in (out / "drives").iterdir()} == set(after)
    motions = {(out / "drives" / name / "motions.csv").read_bytes() for name in after}
    assert len(motions) == 1
