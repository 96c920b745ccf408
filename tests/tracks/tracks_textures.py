"""Images whose motion is known exactly, to any fraction of a pixel."""

from __future__ import annotations

import numpy as np

from farpoint.tracks import LucasKanadeOptions, refinement
from farpoint.tracks.pyramid import build_pyramid


class Waves:
    """A texture of plane waves below half of the sampling frequency, seen through any warp."""

    def __init__(self, seed: int, shape: tuple[int, int] = (200, 280), waves: int = 160):
        rng = np.random.default_rng(seed)
        self.shape = shape
        frequency = np.exp(rng.uniform(np.log(0.01), np.log(0.2), waves))
        angle = rng.uniform(0, 2 * np.pi, waves)
        self._wave = 2 * np.pi * frequency[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1)
        self._phase = rng.uniform(0, 2 * np.pi, waves)
        amplitude = frequency**-0.3
        self._amplitude = 40 * amplitude / np.sqrt(np.sum(amplitude**2) / 2)

    def grey(
        self, shift: tuple[float, float] = (0, 0), scale: float = 1.0, gain: float = 1.0
    ) -> np.ndarray:
        """The texture moved by `moved`: exact values at the pixels' centres."""
        height, width = self.shape
        x = (np.arange(width) - width / 2 - shift[0]) / scale + width / 2
        y = (np.arange(height) - height / 2 - shift[1]) / scale + height / 2
        # cos(a + b), so that the waves are summed by matrix products.
        across = np.outer(self._wave[:, 0], x)
        down = np.outer(self._wave[:, 1], y) + self._phase[:, None]
        weight = gain * self._amplitude[:, None]
        even = (weight * np.cos(down)).T @ np.cos(across)
        odd = (weight * np.sin(down)).T @ np.sin(across)
        return 128 + even - odd

    def at(self, points: np.ndarray) -> np.ndarray:
        """Exact values of the still texture at points (..., 2), px."""
        return 128 + np.cos(points @ self._wave.T + self._phase) @ self._amplitude

    def moved(
        self, points: np.ndarray, shift: tuple[float, float] = (0, 0), scale: float = 1.0
    ) -> np.ndarray:
        """Where points (N, 2) of the still image are in the moved one."""
        centre = np.array(self.shape[::-1]) / 2
        return (points - centre) * scale + centre + shift


def photo(grey: np.ndarray, noise: float = 0.0, rng: np.random.Generator | None = None):
    """What a camera makes of it: noise of this standard deviation, rounding, uint8."""
    if rng is not None:
        grey = grey + rng.normal(0, noise, grey.shape)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def refine(image0: np.ndarray, image1: np.ndarray, *matches):
    """`refinement.refine` between plain images."""
    finest = LucasKanadeOptions(levels=0)
    return refinement.refine(build_pyramid(image0, finest), build_pyramid(image1, finest), *matches)
