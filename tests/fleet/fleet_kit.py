"""A few drives of small pictures, and the fleet as a process of its own."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path

from cli_kit import CALIBRATION, start

QUICK = ("--no-overlay", "--no-report", "--workers", "2")


def write_drives(folder: Path, shots: Path, count: int) -> Path:
    """So many folders with the same images, and their calibration."""
    folder.mkdir(exist_ok=True)
    (folder / "sensor.yaml").write_text(CALIBRATION)
    for number in range(count):
        shutil.copytree(shots, folder / f"drive{number}")
    return folder


def start_fleet(drives: Path, out: Path, *more: str | Path):
    return start(
        "fleet", drives / "drive*", "--camera", drives / "sensor.yaml", "--out", out, *QUICK, *more
    )


def rows_of_fleet(out: Path) -> dict[str, dict[str, str]]:
    """Rows of ``fleet.csv`` by the name of the source."""
    with (out / "fleet.csv").open(newline="") as file:
        return {Path(row["source"]).name: row for row in csv.DictReader(file)}


def finished(out: Path) -> dict[str, tuple[int, int]]:
    """Which drives are finished, each with what would change if it were run again."""
    return {
        record.parent.name: (record.stat().st_ino, record.stat().st_mtime_ns)
        for record in (out / "drives").glob("drive*/fleet.json")
    }
