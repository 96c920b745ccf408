"""Windows of an image at sub-pixel positions, for Lucas-Kanade and the affine refinement.

An image is a flat array of bytes with a border, so that a window may extend beyond the image. For
vector instructions, the length of a window's lines in memory is a multiple of `VECTOR_LANES`
pixels. The padding at the end of a line has the weight 0 (`Window.inside`). Floats are float32,
which is accurate enough for sums over a few hundred 8-bit values.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.compile import inlined_kernel, inner_kernel
from farpoint._kernels.constants import VECTOR_LANES

__all__ = [
    "Image",
    "Termination",
    "Weights",
    "Window",
    "blank_values",
    "blank_window",
    "differentiate",
    "line_px",
    "read",
    "relaxed_share",
    "room_px",
    "sample",
    "value_at",
    "weights_of",
]


Weights = tuple[np.floating, np.floating, np.floating, np.floating]


class Image(NamedTuple):
    """An image in a flat array with a border."""

    values: np.ndarray
    """(V,) uint8."""
    place: int
    """Index of the image's pixel (0, 0)."""
    line: int
    """Stride from one line to the next."""
    width: int
    """Width, px."""
    height: int
    """Height, px."""


class Window(NamedTuple):
    """Window around a point, stored as lines of pixels."""

    half: int
    """Half-size: the window is ``2 half + 1`` pixels wide and high."""
    line: int
    """Stride from one line to the next."""
    grey: np.ndarray
    """(S,) values, grey levels."""
    gx: np.ndarray
    """(S,) gradient to the right, grey levels / px."""
    gy: np.ndarray
    """(S,) gradient downwards, grey levels / px."""
    inside: np.ndarray
    """(S,) 1 for pixels of the window, 0 for the padding of the lines."""


class Termination(NamedTuple):
    """Termination criterion of an iteration."""

    iterations: int
    """Maximum number of steps."""
    tolerance: float
    """Length of a step, px, below which the iteration has converged."""


def line_px(width: int) -> int:
    """Stride of lines of ``width`` pixels: the next multiple of `VECTOR_LANES`."""
    return -(-width // VECTOR_LANES) * VECTOR_LANES


def room_px(rows: int, line: int) -> int:
    """Size of a buffer for ``rows`` lines, and for pixels that are read beyond the last line."""
    return (rows + 1) * line + VECTOR_LANES


def blank_values(size: int) -> np.ndarray:
    """Zero-initialised float32 buffer."""
    return np.zeros(size, np.float32)


def blank_window(half: int, line: int) -> Window:
    """Buffers of a window with lines of length ``line``; ``inside`` is already filled in."""
    width = 2 * half + 1
    size = width * line
    inside = blank_values(size)
    inside.reshape(width, line)[:, :width] = 1.0
    return Window(half, line, blank_values(size), blank_values(size), blank_values(size), inside)


@inner_kernel
def read(image: Image, left: int, top: int, rows: int, line: int, pixels: np.ndarray) -> None:
    """Read lines of an image as floats into ``pixels``, beginning at the pixel (left, top)."""
    values = image.values
    place, stride = np.uintp(image.place + top * image.line + left), np.uintp(image.line)
    out, length = np.uintp(0), np.uintp(line)
    for _ in range(rows):
        for j in range(length):
            pixels[out + j] = np.float32(values[place + j])
        place += stride
        out += length


@inner_kernel
def weights_of(x: float, y: float) -> Weights:
    """Bilinear weights at the fraction (x, y), 0 to 1, between a pixel and three neighbours.

    The weights are those of the pixel and of the neighbours to the right, below, and below right.
    """
    a, b, one = np.float32(x), np.float32(y), np.float32(1.0)
    return (one - a) * (one - b), a * (one - b), (one - a) * b, a * b


@inlined_kernel
def value_at(pixels: np.ndarray, i: np.uintp, line: int, weights: Weights) -> np.floating:
    """Bilinear interpolation between the pixel ``i`` and its three neighbours.

    Indices are unsigned, because a signed index may count from the end and needs a check.
    """
    right, below = np.uintp(1), np.uintp(line)
    above = weights[0] * pixels[i] + weights[1] * pixels[i + right]
    return above + (weights[2] * pixels[i + below] + weights[3] * pixels[i + below + right])


@inner_kernel
def sample(
    image: Image,
    x: float,
    y: float,
    rows: int,
    line: int,
    pixels: np.ndarray,
    patch: np.ndarray,
) -> None:
    """Fill the lines of ``patch`` with interpolated values. The first value is at (x, y)."""
    left, top = math.floor(x), math.floor(y)
    read(image, left, top, rows + 1, line, pixels)
    weights = weights_of(x - left, y - top)
    for i in range(np.uintp(rows * line)):
        patch[i] = value_at(pixels, i, line, weights)


@inner_kernel
def differentiate(patch: np.ndarray, patch_line: int, window: Window) -> None:
    """Values and Scharr gradients of a window, from a patch one pixel larger on each side."""
    line, inside, grey, gx, gy = window.line, window.inside, window.grey, window.gx, window.gy
    # If the lines of patch and window have the same length, the window is one line in memory.
    rows = 2 * window.half + 1
    rows, length = (1, rows * line) if line == patch_line else (rows, line)
    side, middle = np.float32(3.0 / 32.0), np.float32(10.0 / 32.0)
    one, two = np.uintp(1), np.uintp(2)
    for v in range(rows):
        i, out = np.uintp(v * patch_line), np.uintp(v * line)
        j, k = i + np.uintp(patch_line), i + np.uintp(2 * patch_line)
        for u in range(np.uintp(length)):
            grey[out + u] = patch[j + u + one]
            dx = side * (patch[i + u + two] - patch[i + u] + patch[k + u + two] - patch[k + u])
            dx += middle * (patch[j + u + two] - patch[j + u])
            gx[out + u] = inside[out + u] * dx
            dy = side * (patch[k + u] - patch[i + u] + patch[k + u + two] - patch[i + u + two])
            dy += middle * (patch[k + u + one] - patch[i + u + one])
            gy[out + u] = inside[out + u] * dy


@inner_kernel
def relaxed_share(
    share: float, step_x: float, step_y: float, before_x: float, before_y: float
) -> float:
    """Share of a step to take, 0.5 to 1, from the share of the previous step (secant method).

    The gradients of a sampled image are too small, by up to 50 % in sharp parts of the image. The
    steps of Gauss-Newton are therefore too long, and the iteration oscillates. The component of the
    new step along the previous step is the part of the previous step that was missing; a negative
    component shows that the previous step was too long.
    """
    square = before_x * before_x + before_y * before_y
    left = (step_x * before_x + step_y * before_y) / square if square > 0.0 else 0.0
    return min(max(share / (1.0 - min(left, 0.5)), 0.5), 1.0)
