"""Kernels compiled once for all workers of a machine."""

from __future__ import annotations

import numpy as np

from farpoint._kernels.discs import draw_discs
from farpoint.camera import Camera
from farpoint.odometry import Odometry

__all__ = ["compile_kernels"]

_LENS = (320, 240, 240.0, 240.0, 159.5, 119.5)
# A pinhole has other kernels with distortion, and a rolling shutter has its own.
_CAMERAS = (
    Camera.pinhole(*_LENS),
    Camera.pinhole(*_LENS, distortion=(0.01, 0.0, 0.0, 0.0)).with_readout(0.02, 0.002),
)
_FRAMES = 5


def compile_kernels() -> None:
    """Run small drives and draw, so that all kernels of a run are in numba's cache on this machine.

    The images are large enough for 60 matches, because halves of the tracks correct the covariance
    only from 60 matches on.
    """
    from farpoint.synthetic import render_drive  # loaded on use, and once

    for camera in _CAMERAS:
        odometry = Odometry(camera)
        for frame in render_drive(camera, frames=_FRAMES, seed=0):
            odometry.process(frame.image, frame.timestamp)
    draw_discs(np.zeros((8, 8, 3), np.uint8), np.array([[4.0, 4.0]]), 2.0, (0, 0, 0))
