"""Windows of an image, read between its pixels: what Lucas-Kanade and the refinement stand on.

An image is a flat array of bytes with a border around it, so that a window may reach beyond it.

Lines of a window are as long as the processor likes them, `LANES` pixels or a multiple. What lies
beyond the window has no weight. Floats are float32: a window holds a few hundred 8-bit values.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.compile import inlined_kernel, inner_kernel

__all__ = [
    "LANES",
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

LANES = 8

Weights = tuple[np.floating, np.floating, np.floating, np.floating]


class Image(NamedTuple):
    """Where an image lies in an array."""

    values: np.ndarray
    """(V,) uint8."""
    place: int
    """Of its pixel (0, 0)."""
    line: int
    """Places from one of its lines to the next."""
    width: int
    """px."""
    height: int
    """px."""


class Window(NamedTuple):
    """A window around a point, by lines of pixels."""

    half: int
    """It is ``2 half + 1`` pixels wide and high."""
    line: int
    """Places from one of its lines to the next."""
    grey: np.ndarray
    """(S,) its values, grey levels."""
    gx: np.ndarray
    """(S,) its gradient to the right, grey levels / px."""
    gy: np.ndarray
    """(S,) its gradient downwards."""
    inside: np.ndarray
    """(S,) 1 where it has a pixel, 0 beyond its lines."""


class Termination(NamedTuple):
    """When a search ends."""

    iterations: int
    """Steps at most."""
    tolerance: float
    """It ends with a step that is shorter, px."""


def line_px(width: int) -> int:
    """Pixels from one line of a window to the next."""
    return -(-width // LANES) * LANES


def room_px(rows: int, line: int) -> int:
    """Places for so many lines, and for what is read beyond the last of them."""
    return (rows + 1) * line + LANES


def blank_values(size: int) -> np.ndarray:
    """Room for so many values, zeros at first."""
    return np.zeros(size, np.float32)


def blank_window(half: int, line: int) -> Window:
    """Room for a window with lines of this length, which says where it has pixels."""
    width = 2 * half + 1
    size = width * line
    inside = blank_values(size)
    inside.reshape(width, line)[:, :width] = 1.0
    return Window(half, line, blank_values(size), blank_values(size), blank_values(size), inside)


@inner_kernel
def read(image: Image, left: int, top: int, rows: int, line: int, pixels: np.ndarray) -> None:
    """Fill the lines of ``pixels`` from a place of the image on, the first of them its (left, top).

    They are turned into floats once, and looked at between them many times.
    """
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
    """Weights of a pixel, of those to its right, below and across, for a value (x, y) from it."""
    a, b, one = np.float32(x), np.float32(y), np.float32(1.0)
    return (one - a) * (one - b), a * (one - b), (one - a) * b, a * b


@inlined_kernel
def value_at(pixels: np.ndarray, i: np.uintp, line: int, weights: Weights) -> np.floating:
    """Value between the pixel ``i`` and its three neighbours.

    Both unsigned: an index that might count from the end is looked at, one by one.
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
    """Fill the lines of ``patch`` with values between pixels, the first of them at (x, y)."""
    left, top = math.floor(x), math.floor(y)
    read(image, left, top, rows + 1, line, pixels)
    weights = weights_of(x - left, y - top)
    for i in range(np.uintp(rows * line)):
        patch[i] = value_at(pixels, i, line, weights)


@inner_kernel
def differentiate(patch: np.ndarray, patch_line: int, window: Window) -> None:
    """Values and Scharr gradients of a window, from a patch that reaches a pixel farther."""
    line, inside, grey, gx, gy = window.line, window.inside, window.grey, window.gx, window.gy
    # Where both have lines of one length, they are one line.
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
    """Share of a step to take, 0.5 to 1, given the share taken of the step before.

    The gradients of a sampled image are too flat, by a half where it is sharp, and steps too long
    by as much: they go to and fro. Had all of the last step been as long as it should, none would
    be left; what is left of it tells by how much it was not (the secant of the steps).
    """
    square = before_x * before_x + before_y * before_y
    left = (step_x * before_x + step_y * before_y) / square if square > 0.0 else 0.0
    return min(max(share / (1.0 - min(left, 0.5)), 0.5), 1.0)
