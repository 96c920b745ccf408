"""A fleet: every drive once and whole, what is finished is not run again, a failure is a row."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from cli_kit import PATIENCE_S, write_folder
from fleet_kit import (
    finished,
    rows_of_fleet,
    start_fleet,
    wait_for,
    workers_of,
    write_drives,
)

DRIVES = 3


def test_every_drive_is_run_once(tmp_path: Path, shots: Path):
    drives, out = write_drives(tmp_path / "in", shots, DRIVES), tmp_path / "out"
    write_folder(drives / "drive-broken", [b"no image"])
    process = start_fleet(drives, out)
    _, headers = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1, headers
    before = finished(out)
    assert len(before) == DRIVES
    rows = rows_of_fleet(out)
    broken = rows.pop("drive-broken")
    assert broken["state"] == "failed"
    assert "no image" in broken["error"]
    assert {row["state"] for row in rows.values()} == {"done"}
    assert {row["ok"] for row in rows.values()} == {"5"}
    # Equal drives have equal motions, and nothing is left beside them.
    assert {p.name for p in (out / "drives").iterdir()} == set(before)
    motions = {(out / "drives" / name / "motions.csv").read_bytes() for name in before}
    assert len(motions) == 1
    # One drive is lost: it is run again, and no other.
    lost = sorted(before)[0]
    for file in (out / "drives" / lost).iterdir():
        file.unlink()
    (out / "drives" / lost).rmdir()
    process = start_fleet(drives, out)
    _, headers = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1, headers
    after = finished(out)
    assert len(after) == DRIVES
    del before[lost], after[lost]
    assert after == before


@pytest.mark.skipif(os.name == "nt", reason="signals")
@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
def test_killed_workers_and_an_interruption_lose_nothing(
    tmp_path: Path, shots: Path, ending: signal.Signals
):
    drives, out = write_drives(tmp_path / "in", shots, DRIVES), tmp_path / "out"
    images = sorted(shots.iterdir())
    endless = drives / "drive-endless"  # for the time of this test
    endless.mkdir()
    for number in range(20_000):
        os.link(images[number % len(images)], endless / f"{number:06d}.png")
    process = start_fleet(drives, out)
    for worker in wait_for(lambda: workers_of(process), process):
        worker.kill()  # while it starts
    wait_for(lambda: finished(out), process)
    for worker in workers_of(process):
        worker.kill()  # while it works: one of them at the endless drive
    before = wait_for(lambda: len(finished(out)) == DRIVES and finished(out), process)
    process.send_signal(ending)
    _, headers = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130, headers
    *progress, last = headers.splitlines()
    assert last.startswith("farpoint: interrupted")
    assert all("drives" in line for line in progress), headers
    states = {name: row["state"] for name, row in rows_of_fleet(out).items()}
    assert states.pop("drive-endless") == "waiting"
    assert set(states.values()) == {"done"}
    assert {path.name for path in (out / "drives").iterdir()} == set(before)
    # It ends after all: the others are not run again.
    for image in sorted(endless.iterdir())[len(images) :]:
        image.unlink()
    process = start_fleet(drives, out)
    _, headers = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, headers
    after = finished(out)
    assert len(after) == DRIVES + 1
    assert after.items() >= before.items()
