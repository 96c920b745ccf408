"""What must hold of the folder of a run, however it ended."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import av
import numpy as np

from farpoint.odometry import OdometryResult
from farpoint.sinks import OutputFolder
from farpoint.sinks.halves import read_halves
from farpoint.sinks.motions import read_motions
from farpoint.sinks.positions import read_positions
from farpoint.trajectory.files import iter_tum


def put(folder: OutputFolder, result: OdometryResult, image: np.ndarray | None) -> None:
    """Write a result, and its pose as one that is settled."""
    folder.write(result, image)
    folder.write_final_poses([result])


LINES = ("motions.csv", "trajectory.tum", "trajectory.kitti", "positions.csv", "halves.csv")


def check_readable(folder: Path) -> None:
    """Every file that is there can be read by what reads it."""
    readers = {
        "motions.csv": read_motions,
        "positions.csv": read_positions,
        "halves.csv": read_halves,
        "trajectory.tum": lambda path: list(iter_tum(path, whole_lines=True)),
        "overlay.mp4": pictures_in,
        "report.html": check_page,
        "run.json": record_in,
    }
    for name, read in readers.items():
        if (folder / name).exists():
            read(folder / name)
    if (folder / "overlay.mp4").exists():
        assert pictures_in(folder / "overlay.mp4") > 0


def check_whole(folder: Path) -> None:
    """Nothing half-written keeps its name, and nothing is left beside the outputs."""
    check_readable(folder)
    for name in LINES:
        if (path := folder / name).exists():
            assert path.read_bytes()[-1:] in (b"\n", b""), name
    left = [path.name for path in folder.iterdir()]
    assert not [
        name for name in left if name.endswith((".part", ".new")) or name.startswith(".")
    ], left


def pictures_in(video: Path) -> int:
    """Pictures that can be decoded; the boxes of the file are whole (ISO/IEC 14496-12)."""
    data, at = video.read_bytes(), 0
    while at < len(data):
        at += int.from_bytes(data[at : at + 4], "big")
    assert at == len(data)
    with av.open(str(video)) as container:
        return sum(1 for _ in container.decode(video=0))


def check_page(page: Path) -> None:
    assert page.read_text(encoding="utf-8").rstrip().endswith("</html>")


def record_in(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8"))
