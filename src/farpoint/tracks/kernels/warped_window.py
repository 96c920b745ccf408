"""Residual of a warped window of the second image."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from farpoint._kernels.compile import inlined_kernel, step_kernel
from farpoint._kernels.scalars import fma
from farpoint.tracks.constants import MAX_WINDOW_STRETCH, PIXELS_AT_ONCE
from farpoint.tracks.kernels.affine_jacobian import Template
from farpoint.tracks.kernels.windows import Image, blank_values, line_px, read, room_px

__all__ = ["Around", "blank_around", "residual_of"]

_WIDE = np.int64(PIXELS_AT_ONCE)  # a literal would be of another numba type


class Around(NamedTuple):
    """Copy of the pixels around a warped window."""

    pixels: np.ndarray
    """All pixels that the window may need, by lines."""
    line: int
    """Stride from one line to the next."""


def blank_around(half: int) -> Around:
    """Buffer for the surroundings of a window that is ``2 half + 1`` pixels wide."""
    span = int(2.0 * MAX_WINDOW_STRETCH * half) + 5
    line = line_px(span)
    return Around(blank_values(room_px(span, line) + PIXELS_AT_ONCE), line)


@step_kernel
def residual_of(
    image: Image,
    x: float,
    y: float,
    template: Template,
    theta: np.ndarray,
    around: Around,
    residual: np.ndarray,
) -> bool:
    """Write the residual: warped second image minus template with the change of brightness.

    The function returns False if the warped window leaves the image or is stretched too much.
    """
    window, contrast = template.window, template.contrast
    half, grey = window.half, window.grey
    reach_x = half * (abs(1.0 + theta[2]) + abs(theta[3]))
    reach_y = half * (abs(theta[4]) + abs(1.0 + theta[5]))
    x += theta[0]
    y += theta[1]
    # Comparisons with NaN are False: the function then returns False, too.
    if not (reach_x <= x < image.width - 1 - reach_x and reach_y <= y < image.height - 1 - reach_y):
        return False
    if max(reach_x, reach_y) > MAX_WINDOW_STRETCH * half:
        return False
    left, top = int(x - reach_x) - 1, int(y - reach_y) - 1
    read(image, left, top, int(2.0 * reach_y) + 5, around.line, around.pixels)
    _warp(around, x - left, y - top, half, theta, window.line, residual)
    gain, offset = np.float32(theta[6]), np.float32(theta[7])
    for i in range(np.uintp(len(grey))):
        residual[i] += gain * contrast[i] - grey[i] - offset
    return True


@step_kernel
def _warp(
    around: Around,
    x: float,
    y: float,
    half: int,
    theta: np.ndarray,
    line: int,
    out: np.ndarray,
) -> None:
    """Interpolated values of a warped window around (x, y).

    A line is interpolated in steps. A step is so short that the warp displaces its values by at
    most 1 px from a 1 px grid. Each value of a step is therefore interpolated from 3 x 3 pixels,
    which are one pixel farther right than the 3 x 3 pixels of the previous value. Each step writes
    `PIXELS_AT_ONCE` values. If a step has fewer values, the next step overwrites the surplus, and
    values after the end of a line are undefined.
    """
    pixels, pixel_line = around.pixels, around.line
    xu, xv, yu, yv = theta[2], theta[3], theta[4], theta[5]
    step = _WIDE
    while (step - 1) * max(abs(xu), abs(yu)) > 1.0:
        step //= 2
    drift_x, drift_y = (step - 1) * min(xu, 0.0), (step - 1) * min(yu, 0.0)
    slope = np.float32(xu), np.float32(yu)
    for v in range(2 * half + 1):
        for part in range(0, 2 * half + 1, step):
            px = x + xv * (v - half) + (1.0 + xu) * (part - half)
            py = y + (1.0 + yv) * (v - half) + yu * (part - half)
            left, top = int(px + drift_x), int(py + drift_y)
            place = np.uintp(top * pixel_line + left)
            begin = np.float32(px - left), np.float32(py - top)
            _warp_part(pixels, place, pixel_line, begin, slope, v * line + part, out)


@step_kernel
def _warp_part(
    pixels: np.ndarray,
    i: np.uintp,
    line: int,
    begin: tuple[float, float],
    slope: tuple[float, float],
    to: int,
    out: np.ndarray,
) -> None:
    """Values of a part of a line, interpolated bilinearly between 3 x 3 pixels for each value.

    The upper left pixel of the 3 x 3 pixels of value ``j`` has the index ``i + j``. The offset of
    the value from this pixel is ``begin + j * slope`` (x, y), 0 to 2 px. The value is written to
    index ``to + j``.
    """
    zero, one = np.float32(0.0), np.float32(1.0)
    (x, y), (slope_x, slope_y) = begin, slope
    o = np.uintp(to)
    k, m = i + np.uintp(line), i + np.uintp(2 * line)
    for j in range(np.uintp(PIXELS_AT_ONCE)):
        u = np.float32(np.int32(j))
        to_x, to_y = fma(slope_x, u, x), fma(slope_y, u, y)
        a, b = min(to_x, one), max(to_x - one, zero)
        row0 = _along(pixels, i + j, a, b)
        row1 = _along(pixels, k + j, a, b)
        row2 = _along(pixels, m + j, a, b)
        a, b = min(to_y, one), max(to_y - one, zero)
        out[o + j] = fma(b, row2 - row1, fma(a, row1 - row0, row0))


@inlined_kernel
def _along(pixels: np.ndarray, i: np.uintp, a: float, b: float) -> float:
    """Linear interpolation ``a + b`` px to the right of the i-th pixel, a and b from 0 to 1."""
    left, middle, right = pixels[i], pixels[i + np.uintp(1)], pixels[i + np.uintp(2)]
    return fma(b, right - middle, fma(a, middle - left, left))
