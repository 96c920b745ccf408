"""KITTI sequences: odometry (``image_0``, ``times.txt``) and raw (``image_00/data``)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from farpoint.frames.calibration import find_calibration
from farpoint.frames.folder import sequence_in
from farpoint.frames.sequence import ImageSequence

__all__ = ["open_kitti"]

# The left grey camera, then the left colour camera. Right cameras are opened by their own folder.
_CAMERAS = ("image_0", "image_2", "image_00/data", "image_02/data")


def open_kitti(folder: Path, *, fps: float | None) -> ImageSequence | None:
    """The left camera of a KITTI sequence; None if `folder` is no such sequence.

    Time stamps come from ``times.txt`` (odometry) or the camera's ``timestamps.txt`` (raw).
    """
    for camera in _CAMERAS:
        if sequence := sequence_in(folder / camera, root=folder, fps=fps):
            # Raw drives keep their calibration beside the drives of the same day.
            home = folder.absolute()
            return replace(sequence, calibration_path=find_calibration(home, home.parent))
    return None
