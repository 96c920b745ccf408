"""A fleet: every drive once and whole, what is finished is not run again, a failure is a row."""

from __future__ import annotations

from pathlib import Path

from cli_kit import PATIENCE_S, write_folder
from fleet_kit import finished, rows_of_fleet, start_fleet, write_drives

DRIVES = 3


def test_every_drive_is_run_once(tmp_path: Path, shots: Path):
    drives, out = write_drives(tmp_path / "in", shots, DRIVES), tmp_path / "out"
    write_folder(drives / "drive-broken", [b"no image"])
    process = start_fleet(drives, out)
    _, told = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1, told
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
    _, told = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1, told
    after = finished(out)
    assert len(after) == DRIVES
    del before[lost], after[lost]
    assert after == before
