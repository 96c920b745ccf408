"""Kernels compiled once for all workers of a machine."""

from __future__ import annotations

from farpoint.camera import Camera
from farpoint.odometry import Odometry

__all__ = ["compile_kernels"]

_CAMERA = Camera.pinhole(160, 120, 120.0, 120.0, 79.5, 59.5)


def compile_kernels() -> None:
    """Run a small drive, so that what numba compiles is in its cache on this machine."""
    from farpoint.synthetic import render_drive  # loaded on use, and once

    odometry = Odometry(_CAMERA)
    for frame in render_drive(_CAMERA, frames=4, seed=0):
        odometry.process(frame.image, frame.timestamp)
