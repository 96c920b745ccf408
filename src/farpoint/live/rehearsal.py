"""Everything once, before the first frame of a live session."""

from __future__ import annotations

import numpy as np

from farpoint.camera import Camera, CameraGuess, camera_for
from farpoint.odometry import Odometry
from farpoint.sinks import LiveViewer, ViewerOptions

__all__ = ["rehearse"]


def rehearse(camera: Camera | CameraGuess, viewer: ViewerOptions) -> None:
    """Go through everything once: what is loaded or compiled on use would cost frames later."""
    known_size = camera.size if isinstance(camera, Camera) else None
    width, height = known_size or (320, 240)
    camera, _ = camera_for(camera, width, height)
    blocks = np.random.default_rng(0)
    texture = blocks.integers(0, 255, (height // 8 + 2, width // 8 + 2), np.uint8)
    large = np.kron(texture, np.ones((8, 8), np.uint8))
    images = [large[shift:, shift:][:height, :width].copy() for shift in (0, 2, 4, 6)]
    odometry, display = Odometry(camera), None
    if viewer.wanted:
        display = LiveViewer(ViewerOptions(), "rehearsal", camera)  # into nowhere
    try:
        for index, image in enumerate(images):
            result = odometry.process(image, 0.1 * index)
            if display is not None:
                display.write(result, image)
    finally:
        if display is not None:
            display.close()
