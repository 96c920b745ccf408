"""A long run takes no more memory than a short one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli_kit import CommandLine, statuses_of, there_and_back, write_folder

from memory import peak_bytes

Pictures = tuple[np.ndarray, ...]


def test_memory_does_not_grow_with_the_length(
    farpoint: CommandLine,
    tmp_path: Path,
    images: Pictures,
    calibration: Path,
    monkeypatch: pytest.MonkeyPatch,
):
    """Of Python and NumPy; the report, written at the end, has a test of its own."""
    # How many frames wait for the film depends on how busy the machine is: here at most one.
    monkeypatch.setattr("farpoint.sinks.background.WAITING", 1)
    repeated = there_and_back(images)
    arguments = ("--camera", calibration, "--no-report", "--out")

    def peak(name: str, times: int) -> int:
        command = ("run", write_folder(tmp_path / name, times * repeated), *arguments)
        return peak_bytes(lambda: farpoint(*command, tmp_path / f"{name}-out"))

    first = write_folder(tmp_path / "first", images[:4])  # what is loaded and compiled on use
    farpoint("run", first, *arguments, tmp_path / "first-out")
    # Long enough for the window over keyframes to be full.
    short, long = peak("short", 4), peak("long", 9)
    assert len(statuses_of(tmp_path / "long-out")) == 9 * len(repeated) - 1
    images_more = 5 * len(repeated) * images[0].nbytes
    assert long - short < 0.05 * images_more
