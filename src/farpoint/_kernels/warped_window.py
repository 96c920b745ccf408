"""A window of the second image, warped as the first one's is, and what differs."""

from __future__ import annotations

import numpy as np

from farpoint._kernels.compile import inlined_kernel, inner_kernel
from farpoint._kernels.fused import fused
from farpoint._kernels.windows import line_px, read, room_px

__all__ = ["pixels_for", "residual_of"]

_STEP = 16  # pixels of a line that are read at once
_WIDE = np.int64(_STEP)  # as a variable's value: a plain number would be a type of its own
_MOST = 2.0  # a window that is stretched more than that is none


@inner_kernel
def pixels_for(half):
    """Room for all pixels between which a warped window is read."""
    return np.zeros(room_px(_span(half), line_px(_span(half))) + _STEP, np.float32)


@inner_kernel
def _span(half):
    return int(2.0 * _MOST * half) + 5


@inner_kernel
def residual_of(values, here, x, y, half, template, contrast, theta, pixels, residual):
    """Second image, warped, minus the brightness-corrected template; False if it leaves it."""
    reach_x = half * (abs(1.0 + theta[2]) + abs(theta[3]))
    reach_y = half * (abs(theta[4]) + abs(1.0 + theta[5]))
    x += theta[0]
    y += theta[1]
    # Written so that a NaN is outside too.
    if not (reach_x <= x < here[2] - 1 - reach_x and reach_y <= y < here[3] - 1 - reach_y):
        return False
    if max(reach_x, reach_y) > _MOST * half:
        return False
    left, top, line = int(x - reach_x) - 1, int(y - reach_y) - 1, line_px(_span(half))
    read(values, here, left, top, int(2.0 * reach_y) + 5, line, pixels)
    _warp(pixels, line, x - left, y - top, half, theta, len(template) // (2 * half + 1), residual)
    gain, offset = np.float32(theta[6]), np.float32(theta[7])
    for i in range(np.uintp(len(template))):
        residual[i] += gain * contrast[i] - template[i] - offset
    return True


@inner_kernel
def _warp(pixels, pixel_line, x, y, half, theta, line, out):
    """Values of a window around (x, y) between pixels, warped; beyond its lines anything.

    Seen from a pixel that moves on as if there were no warp, pixels side by side need the same
    neighbours as long as the warp moves them by a pixel at most. So many are read in one step;
    `_STEP` are written each time, and what is wrong of these is overwritten by the next step.
    """
    xu, xv, yu, yv = theta[2], theta[3], theta[4], theta[5]
    step = _WIDE
    while (step - 1) * max(abs(xu), abs(yu)) > 1.0:
        step //= 2
    drift_x, drift_y = (step - 1) * min(xu, 0.0), (step - 1) * min(yu, 0.0)
    slope_x, slope_y = np.float32(xu), np.float32(yu)
    for v in range(2 * half + 1):
        for part in range(0, 2 * half + 1, step):
            px = x + xv * (v - half) + (1.0 + xu) * (part - half)
            py = y + (1.0 + yv) * (v - half) + yu * (part - half)
            left, top = int(px + drift_x), int(py + drift_y)
            place = np.uintp(top * pixel_line + left)
            from_x, from_y = np.float32(px - left), np.float32(py - top)
            _warp_part(
                pixels, place, pixel_line, from_x, from_y, slope_x, slope_y, v * line + part, out
            )


@inlined_kernel
def _warp_part(pixels, i, stride, x, y, slope_x, slope_y, begin, out):
    """Values between three by three pixels that move on along a line, in steps as warped.

    Between these pixels, values go up or down along straight lines.

    Parameters
    ----------
    i : int
        Of the pixel at the upper left.
    x, y : float32
        Place of the first value from there on, 0 to 2 px.
    slope_x, slope_y : float32
        By how much the next one is farther.
    """
    zero, one = np.float32(0.0), np.float32(1.0)
    o = np.uintp(begin)
    k, m = i + np.uintp(stride), i + np.uintp(2 * stride)
    for j in range(np.uintp(_STEP)):
        u = np.float32(np.int32(j))
        to_x, to_y = fused(slope_x, u, x), fused(slope_y, u, y)
        a, b = min(to_x, one), max(to_x - one, zero)
        row0 = _along(pixels, i + j, a, b)
        row1 = _along(pixels, k + j, a, b)
        row2 = _along(pixels, m + j, a, b)
        a, b = min(to_y, one), max(to_y - one, zero)
        out[o + j] = fused(b, row2 - row1, fused(a, row1 - row0, row0))


@inlined_kernel
def _along(pixels, i, a, b):
    """Value at ``a + b`` pixels to the right of the i-th."""
    left, middle, right = pixels[i], pixels[i + np.uintp(1)], pixels[i + np.uintp(2)]
    return fused(b, right - middle, fused(a, middle - left, left))
