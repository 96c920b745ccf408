"""Fixtures of the command line's tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli_kit import CALIBRATION, CAMERA, CommandLine, Images, Outcome, RunOver, write_folder

from farpoint.synthetic.sequence import RenderedSequence, render_drive


@pytest.fixture(scope="session")
def drive() -> RenderedSequence:
    return render_drive(CAMERA, frames=12, seed=3)


@pytest.fixture(scope="session")
def images(drive: RenderedSequence) -> tuple[np.ndarray, ...]:
    """Pictures of the drive; every pair of neighbours can be solved."""
    pictures = [frame.image for frame in drive]
    return tuple(picture for picture in pictures if picture is not None)


@pytest.fixture
def farpoint(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> CommandLine:
    return CommandLine(monkeypatch, capsys)


@pytest.fixture
def calibration(tmp_path: Path) -> Path:
    path = tmp_path / "sensor.yaml"
    path.write_text(CALIBRATION)
    return path


@pytest.fixture
def run_over(tmp_path: Path, calibration: Path, farpoint: CommandLine) -> RunOver:
    def run(images: Images) -> tuple[Outcome, Path]:
        source, out = write_folder(tmp_path / "shots", images), tmp_path / "out"
        arguments = ("--camera", calibration, "--out", out, "--no-overlay", "--no-report")
        return farpoint("run", source, *arguments), out

    return run
