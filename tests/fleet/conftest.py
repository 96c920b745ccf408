"""Images of a short drive."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli_kit import CAMERA, write_folder

from farpoint.synthetic.sequence import render_drive


@pytest.fixture(scope="session")
def shots(tmp_path_factory: pytest.TempPathFactory) -> Path:
    frames = render_drive(CAMERA, frames=6, seed=3)
    images = [frame.image for frame in frames if frame.image is not None]
    return write_folder(tmp_path_factory.mktemp("drive") / "shots", images)
