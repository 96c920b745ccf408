"""Textures of the street, and their mip pyramids.

A texture is square, repeats in both directions, and has grey levels around zero.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from scipy import fft

__all__ = ["facade", "noise", "pyramids", "road"]

# Sigma of the blur of every level, in texels of the level. The blur attenuates the frequencies that
# bilinear interpolation distorts.
_LEVEL_SIGMA = 0.8


def noise(rng: np.random.Generator, log2_width: int = 9) -> np.ndarray:
    """Random texture of unit variance with equal power in every octave of spatial frequency."""
    width = 1 << log2_width
    frequency = np.fft.fftfreq(width) * width
    radius = np.hypot(frequency[:, None], np.fft.rfftfreq(width) * width)
    amplitude = np.zeros_like(radius)
    # No power below 3 periods per width, where the repetition of the texture is most visible.
    np.divide(1.0, radius, out=amplitude, where=radius >= 3.0)
    spectrum = np.fft.rfft2(rng.normal(size=(width, width))) * amplitude
    image = np.fft.irfft2(spectrum, s=(width, width))
    return image / image.std()


def facade(rng: np.random.Generator, log2_width: int = 10, *, bays: int = 8) -> np.ndarray:
    """Wall with ``bays`` x ``bays`` bays, most with a window; panes, bars and blinds are random.

    Values are -1 (dark pane) to 0.95 (white sill); the wall is 0, joints between floors -0.35.
    """
    width = 1 << log2_width
    image = np.zeros((width, width))
    pitch = width // bays
    share = rng.uniform((0.42, 0.5), (0.66, 0.68))  # of the bay that is window, across and down
    half = (share * pitch / 2).astype(int)
    bar = pitch // 20
    for joint in range(pitch // 30):  # between floors
        image[joint::pitch, :] = -0.35
    for row in range(bays):
        for column in range(bays):
            x, y = column * pitch + pitch // 2, row * pitch + pitch // 2
            if rng.random() < 0.12:
                continue  # blind bay
            window = image[y - half[1] : y + half[1], x - half[0] : x + half[0]]
            window[:] = 0.8
            window[bar:-bar, bar:-bar] = rng.uniform(-1.0, -0.5)
            window[:, half[0] - bar // 3 : half[0] + bar // 3] = 0.8
            if rng.random() < 0.5:
                window[2 * half[1] // 3 : 2 * half[1] // 3 + bar // 2, bar:-bar] = 0.8
            blind = int(rng.uniform(0.0, 1.6 * half[1])) if rng.random() < 0.4 else 0
            window[bar : max(bar, blind), bar:-bar] = rng.uniform(0.1, 0.6)
            image[y + half[1] : y + half[1] + bar, x - half[0] - bar : x + half[0] + bar] = 0.95
    return image


def road(
    rng: np.random.Generator, block_m: float, road_m: float, log2_width: int = 11
) -> np.ndarray:
    """Ground of one block of a street grid, with marked streets along x = 0 and z = 0.

    The row index increases with z, and the column index with x. One period of the texture is
    ``block_m``. Values are in grey levels relative to asphalt.
    """
    width = 1 << log2_width
    place = (np.arange(width) + 0.5) / width * block_m
    place = (place + block_m / 2) % block_m - block_m / 2
    x, z = place[None, :], place[:, None]
    to_axis = np.minimum(np.abs(x), np.abs(z))
    crossing = (np.abs(x) < road_m / 2 + 2.0) & (np.abs(z) < road_m / 2 + 2.0)
    image = np.where(to_axis < road_m / 2, 0.0, np.where(to_axis < road_m / 2 + 2.0, 45.0, 10.0))
    image[(np.abs(to_axis - road_m / 2 - 0.08) < 0.08) & ~crossing] = 75.0  # kerb
    image[(np.abs(to_axis - road_m / 2 + 0.4) < 0.07) & ~crossing] = 105.0  # edge line
    for across, along in ((x, z), (z, x)):
        to_crossing = np.abs(along) - road_m / 2 - 2.0
        dashes = (np.abs(across) < 0.07) & (along % 6.0 < 3.0) & (to_crossing > 4.0)
        stop = (np.abs(across) < road_m / 2 - 0.4) & (np.abs(to_crossing - 3.4) < 0.2)
        stripes = (np.abs(to_crossing - 1.4) < 1.2) & (np.abs(across) % 1.0 < 0.5)
        image[dashes | stop | (stripes & (np.abs(across) < road_m / 2 - 0.3))] = 110.0
    for _ in range(60):  # patches where the road was mended, and covers
        i, j = rng.integers(0, width, 2)
        h, w = rng.integers(width // 150, width // 25, 2)
        rows, columns = np.arange(i, i + h) % width, np.arange(j, j + w) % width
        image[np.ix_(rows, columns)] += rng.uniform(-18.0, 10.0)
    return image


def pyramids(textures: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """All levels of all textures in one float32 array, and the start and log2 width of each.

    Each level has half the width of the previous level, down to one texel. A texel is at the centre
    of the four texels that it replaces.
    """
    parts: list[np.ndarray] = []
    table, start = [], 0
    for texture in textures:
        table.append((start, len(texture).bit_length() - 1))
        level = _blurred(texture.astype(np.float32), _LEVEL_SIGMA, 0.0)
        while True:
            parts.append(level.ravel())
            start += level.size
            if len(level) == 1:
                break
            # A blur s of this level and a further blur sqrt(3) s give 2 s in texels of this level,
            # which is s in texels of the next level.
            level = _blurred(level, sqrt(3.0) * _LEVEL_SIGMA, 0.5)[::2, ::2]
    return np.concatenate(parts), np.array(table, dtype=np.int64)


def _blurred(level: np.ndarray, sigma: float, shift: float) -> np.ndarray:
    """Blur a texture with a Gaussian and move it by ``shift`` texels left and up."""

    def filtered(frequency: np.ndarray) -> np.ndarray:
        moved = np.exp(2j * np.pi * shift * frequency)
        return (np.exp(-2.0 * (np.pi * sigma * frequency) ** 2) * moved).astype(np.complex64)

    spectrum = fft.rfft2(level)
    spectrum *= filtered(fft.fftfreq(len(level)))[:, None]
    spectrum *= filtered(fft.rfftfreq(len(level)))
    return np.asarray(fft.irfft2(spectrum, s=level.shape))
