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

__all__ = ["LANES", "between", "differentiate", "line_px", "sample", "value_at"]

LANES = 16


@inner_kernel
def line_px(width: int) -> int:
    """Pixels from one line of a window to the next."""
    return -(-width // LANES) * LANES


@inlined_kernel
def between(here, x, y):
    """Place of the pixel at the upper left of (x, y), and the weights of it and its neighbours."""
    left, top = math.floor(x), math.floor(y)
    a, b, one = np.float32(x - left), np.float32(y - top), np.float32(1.0)
    place = here[0] + int(top) * here[1] + int(left)
    return place, ((one - a) * (one - b), a * (one - b), (one - a) * b, a * b)


@inlined_kernel
def value_at(values, i, stride, weights):
    """Value between pixel ``i`` and its three neighbours.

    Both unsigned: an index that might count from the end is looked at, one by one.
    """
    right = np.uintp(1)
    above = weights[0] * values[i] + weights[1] * values[i + right]
    below = weights[2] * values[i + stride] + weights[3] * values[i + stride + right]
    return above + below


@inner_kernel
def sample(values, here, x, y, rows, line, patch):
    """Fill the lines of ``patch`` with values between pixels, the first of them at (x, y)."""
    place, weights = between(here, x, y)
    stride = np.uintp(here[1])
    for v in range(rows):
        for begin in range(0, line, LANES):
            i, out = np.uintp(place + v * here[1] + begin), np.uintp(v * line + begin)
            for j in range(np.uintp(LANES)):
                patch[out + j] = value_at(values, i + j, stride, weights)


@inner_kernel
def differentiate(patch, patch_line, rows, line, weight, window, gx, gy):
    """Values and Scharr gradients of a window, from a patch that reaches a pixel farther."""
    side, middle = np.float32(3.0 / 32.0), np.float32(10.0 / 32.0)
    one, two = np.uintp(1), np.uintp(2)
    for v in range(rows):
        for begin in range(0, line, LANES):
            i = np.uintp(v * patch_line + begin)
            j = i + np.uintp(patch_line)
            k = j + np.uintp(patch_line)
            out = np.uintp(v * line + begin)
            at = np.uintp(begin)
            for u in range(np.uintp(LANES)):
                window[out + u] = patch[j + u + one]
                dx = side * (patch[i + u + two] - patch[i + u] + patch[k + u + two] - patch[k + u])
                dx += middle * (patch[j + u + two] - patch[j + u])
                gx[out + u] = weight[at + u] * dx
                dy = side * (patch[k + u] - patch[i + u] + patch[k + u + two] - patch[i + u + two])
                dy += middle * (patch[k + u + one] - patch[i + u + one])
                gy[out + u] = weight[at + u] * dy
