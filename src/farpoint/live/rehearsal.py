"""Warm-up before the first frame of a live session."""

from __future__ import annotations

import numpy as np

from farpoint.camera import Camera, CameraGuess, camera_for
from farpoint.odometry import Odometry

__all__ = ["rehearse"]


def rehearse(camera: Camera | CameraGuess) -> None:
    """Run each stage once before the session, so that loading and compiling drop no frames."""
    known_size = camera.size if isinstance(camera, Camera) else None
    width, height = known_size or (320, 240)
    camera, _ = camera_for(camera, width, height)
    blocks = np.random.default_rng(0)
    texture = blocks.integers(0, 255, (height // 8 + 2, width // 8 + 2), np.uint8)
    large = np.kron(texture, np.ones((8, 8), np.uint8))
    odometry = Odometry(camera)
    for index, shift in enumerate((0, 2, 4, 6)):
        odometry.process(large[shift:, shift:][:height, :width].copy(), 0.1 * index)
