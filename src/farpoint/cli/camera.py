"""``farpoint camera``: contents of a calibration file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from farpoint.camera import describe, load_camera
from farpoint.errors import printable

__all__ = ["ShowCamera"]


@dataclass(frozen=True, kw_only=True)
class ShowCamera:
    """Print what was read from a calibration file.

    Attributes
    ----------
    calibration : Path
        Calibration file.
    name : str or None
        Name of the camera, for a file with several cameras.
    """

    calibration: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="CALIB")]
    name: str | None = None

    def __call__(self) -> None:
        """Run the command."""
        lines = describe(load_camera(self.calibration, self.name)).splitlines()
        print(*map(printable, lines), sep="\n")
