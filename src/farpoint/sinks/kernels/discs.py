"""Anti-aliased discs drawn into an image."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import kernel

__all__ = ["draw_discs"]


@kernel
def draw_discs(
    pixels: np.ndarray, centres: np.ndarray, radius: float, colour: tuple[float, float, float]
) -> None:
    """Blend discs of one colour into ``pixels`` (H, W, 3); parts outside the image are clipped.

    The coverage of a pixel is linear in the distance of the pixel from the edge of the disc: 1 at
    half a pixel inside the disc, 0 at half a pixel outside. ``centres`` (N, 2) are finite x and y,
    counted from the centre of the first pixel.
    """
    height, width = pixels.shape[0], pixels.shape[1]
    reach = radius + 0.5
    for index in range(len(centres)):
        x, y = centres[index, 0], centres[index, 1]
        top, bottom = max(math.ceil(y - reach), 0), min(math.floor(y + reach), height - 1)
        left, right = max(math.ceil(x - reach), 0), min(math.floor(x + reach), width - 1)
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                distance = math.sqrt((column - x) ** 2 + (row - y) ** 2)
                cover = min(reach - distance, 1.0)
                if cover > 0.0:
                    for channel in range(3):
                        old = float(pixels[row, column, channel])
                        pixels[row, column, channel] = round(old + cover * (colour[channel] - old))
