"""A few drives of small pictures, and the fleet as a process of its own."""

from __future__ import annotations

import csv
import shutil
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import psutil
from cli_kit import CALIBRATION, PATIENCE_S, start

Found = TypeVar("Found")

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


def workers_of(fleet: subprocess.Popen[str]) -> list[psutil.Process]:
    """The processes that do the work."""
    found = []
    for child in psutil.Process(fleet.pid).children():
        try:
            if any("spawn_main" in word for word in child.cmdline()):
                found.append(child)
        except psutil.NoSuchProcess:
            continue
    return found


def wait_for(look: Callable[[], Found], fleet: subprocess.Popen[str]) -> Found:
    """What a look finds once it finds something, while the fleet runs."""
    end = time.monotonic() + PATIENCE_S
    while not (found := look()):
        assert fleet.poll() is None, fleet.communicate()
        assert time.monotonic() < end
        time.sleep(0.02)
    return found
