"""Windows of an image, read between its pixels: what Lucas-Kanade and the refinement stand on.

An image is a flat array of bytes with a border; ``here`` tells where it lies: the place of its
pixel (0, 0), the places from one line to the next, width and height (a row of a pyramid's layout).

Lines of a window are as long as the processor likes them, `LANES` pixels or a multiple. What lies
beyond the window has no weight. Floats are float32: a window holds a few hundred 8-bit values.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inlined_kernel, inner_kernel

__all__ = [
    "LANES",
    "differentiate",
    "line_px",
    "read",
    "relaxed",
    "room_px",
    "sample",
    "value_at",
    "weights_of",
]

LANES = 8


@inner_kernel
def line_px(width: int) -> int:
    """Pixels from one line of a window to the next."""
    return -(-width // LANES) * LANES


@inner_kernel
def read(values, here, left, top, rows, line, pixels):
    """Fill the lines of ``pixels`` from a place of the image on, the first of them its (left, top).

    They are turned into floats once, and looked at between them many times.
    """
    place, stride = np.uintp(here[0] + top * here[1] + left), np.uintp(here[1])
    out, length = np.uintp(0), np.uintp(line)
    for _ in range(rows):
        for j in range(length):
            pixels[out + j] = np.float32(values[place + j])
        place += stride
        out += length


@inner_kernel
def weights_of(x, y):
    """Weights of a pixel, of those to its right, below and across, for a value (x, y) from it."""
    a, b, one = np.float32(x), np.float32(y), np.float32(1.0)
    return (one - a) * (one - b), a * (one - b), (one - a) * b, a * b


@inlined_kernel
def value_at(pixels, i, line, weights):
    """Value between the pixel ``i`` and its three neighbours.

    Both unsigned: an index that might count from the end is looked at, one by one.
    """
    right, below = np.uintp(1), np.uintp(line)
    above = weights[0] * pixels[i] + weights[1] * pixels[i + right]
    return above + (weights[2] * pixels[i + below] + weights[3] * pixels[i + below + right])


@inner_kernel
def sample(values, here, x, y, rows, line, pixels, patch):
    """Fill the lines of ``patch`` with values between pixels, the first of them at (x, y)."""
    left, top = math.floor(x), math.floor(y)
    read(values, here, left, top, rows + 1, line, pixels)
    weights = weights_of(x - left, y - top)
    for i in range(np.uintp(rows * line)):
        patch[i] = value_at(pixels, i, line, weights)


@inner_kernel
def room_px(rows: int, line: int) -> int:
    """Places for so many lines, and for what is read beyond the last of them."""
    return (rows + 1) * line + LANES


@inner_kernel
def differentiate(patch, patch_line, rows, line, weight, window, gx, gy):
    """Values and Scharr gradients of a window, from a patch that reaches a pixel farther."""
    side, middle = np.float32(3.0 / 32.0), np.float32(10.0 / 32.0)
    one, two = np.uintp(1), np.uintp(2)
    for v in range(rows):
        i, out = np.uintp(v * patch_line), np.uintp(v * line)
        j, k = i + np.uintp(patch_line), i + np.uintp(2 * patch_line)
        for u in range(np.uintp(line)):
            window[out + u] = patch[j + u + one]
            dx = side * (patch[i + u + two] - patch[i + u] + patch[k + u + two] - patch[k + u])
            dx += middle * (patch[j + u + two] - patch[j + u])
            gx[out + u] = weight[out + u] * dx
            dy = side * (patch[k + u] - patch[i + u] + patch[k + u + two] - patch[i + u + two])
            dy += middle * (patch[k + u + one] - patch[i + u + one])
            gy[out + u] = weight[out + u] * dy


@inner_kernel
def relaxed(share, step_x, step_y, before_x, before_y):
    """Share of a step to take, 0.5 to 1, given the share taken of the step before.

    The gradients of a sampled image are too flat, by a half where it is sharp, and steps too long
    by as much: they go to and fro. Had all of the last step been as long as it should, none would
    be left; what is left of it tells by how much it was not (the secant of the steps).
    """
    square = before_x * before_x + before_y * before_y
    left = (step_x * before_x + step_y * before_y) / square if square > 0.0 else 0.0
    return min(max(share / (1.0 - min(left, 0.5)), 0.5), 1.0)
