"""Points followed from image to image: Lucas-Kanade with the gradients of the first, by pyramids.

A pyramid is one flat array of bytes; a row of its layout tells where a level lies in it: the place
of the level's pixel (0, 0), the places from one line to the next, width and height. Around every
level there is a border at least as wide as `border_px`, so that a window whose centre is in the
image needs no look at where the image ends.

Templates, gradients and what they are compared with have lines of one length, so that a window is
one stretch of memory: what lies between the window's columns and the end of a line has no gradient,
and no weight by that. Floats are float32, as in `affine_match`.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inner_kernel, kernel, sum_kernel
from farpoint._kernels.windows import (
    LANES,
    differentiate,
    line_px,
    read,
    relaxed,
    room_px,
    sample,
    value_at,
    weights_of,
)

__all__ = ["border_px", "follow_windows"]

# px to each side that a window may move before the image is read anew
_SLACK = np.int64(1)  # as a variable's value: a plain number would be a type of its own


def border_px(half: int) -> int:
    """How wide the border around each level must be for windows of ``2 half + 1`` pixels."""
    return 2 * half + LANES + 4


@kernel
def follow_windows(
    values0, values1, layout, points0, start, half, iterations, tolerance, back, points1
):
    """Find windows of one image in another, from the coarsest level to the finest, and back.

    The way back begins as far from its goal as the way forth did.

    Parameters
    ----------
    values0, values1 : ndarray of uint8, shape (V,)
        Pyramids of both images.
    layout : ndarray of int64, shape (L, 4)
        Of both: the levels to use, the finest first.
    points0 : ndarray of float64, shape (N, 2)
        Centres of the windows in the first image, px.
    start : ndarray of float64, shape (N, 2)
        Where to begin in the second.
    half : int
        Windows are ``2 half + 1`` pixels wide and high.
    iterations : int
        Steps at most at every level.
    tolerance : float
        Steps end when they are shorter, px of the level.
    back : float
        How far from its start a point may come back, px.
    points1 : ndarray of float64, shape (N, 2)
        Out: centres of the windows in the second image; NaN where the finest level has no answer
        (no texture, or no place within the image), or one that does not lead back.
    """
    width = 2 * half + 1
    line = line_px(width + 1 + 2 * _SLACK)
    room = (
        np.zeros(room_px(width + 1 + 2 * _SLACK, line), np.float32),  # pixels as they are
        np.zeros(room_px(width + 2, line), np.float32),  # values between them
        np.zeros(width * line, np.float32),  # the template
        np.zeros(width * line, np.float32),  # its gradients
        np.zeros(width * line, np.float32),
        np.zeros(width * line, np.float32),  # 1 within the window
    )
    for v in range(width):
        room[5][v * line : v * line + width] = 1.0
    patience = iterations, tolerance
    for k in range(len(points0)):
        x0, y0 = points0[k]
        from_x, from_y = start[k]
        points1[k] = np.nan
        x, y, seen = _find(
            values0, values1, layout, (x0, y0), (from_x, from_y), half, patience, room
        )
        if seen:
            from_x, from_y = x + x0 - from_x, y + y0 - from_y
            again_x, again_y, seen = _find(
                values1, values0, layout, (x, y), (from_x, from_y), half, patience, room
            )
            if seen and math.hypot(again_x - x0, again_y - y0) <= back:
                points1[k, 0], points1[k, 1] = x, y


@inner_kernel
def _find(values0, values1, layout, point0, start, half, patience, room):
    """Where the window around a point is in the second image; whether it is."""
    width = 2 * half + 1
    pixels, patch, window, gx, gy, weight = room
    line = len(window) // width
    scale = 0.5 ** (len(layout) - 1)
    x, y = start[0] * scale, start[1] * scale
    seen = False
    for level in range(len(layout) - 1, -1, -1):
        here = layout[level]
        left, top = point0[0] * scale, point0[1] * scale
        seen = _within(here, left, top)
        if seen:
            left, top = left - half - 1, top - half - 1
            sample(values0, here, left, top, width + 2, line, pixels, patch)
            differentiate(patch, line, 1, width * line, weight, window, gx, gy)
            x1, y1, seen = _descend(values1, here, x, y, half, window, gx, gy, patience, pixels)
            if seen:
                x, y = x1, y1
        if level > 0:
            scale, x, y = 2.0 * scale, 2.0 * x, 2.0 * y
    return x, y, seen


@inner_kernel
def _within(here, x, y):
    """Whether a pixel is in the image; NaN is not."""
    return 0.0 <= x <= here[2] - 1.0 and 0.0 <= y <= here[3] - 1.0


@inner_kernel
def _descend(values, here, x, y, half, window, gx, gy, patience, pixels):
    """Gauss-Newton steps on one level from (x, y); whether they stayed in the image."""
    xx, xy, yy = _normal_matrix(gx, gy)
    determinant = xx * yy - xy * xy
    if not determinant > 1e-6 * xx * yy:  # no texture, or along one direction only
        return x, y, False
    before_x, before_y, share = 0.0, 0.0, 1.0
    iterations, tolerance = patience
    line = len(window) // (2 * half + 1)
    left, top = 0, 0
    for step in range(iterations):
        if not _within(here, x, y):
            return x, y, False
        whole_x, whole_y = math.floor(x), math.floor(y)
        beside, below = whole_x - half - left, whole_y - half - top
        if step == 0 or not (0 <= beside <= 2 * _SLACK and 0 <= below <= 2 * _SLACK):
            beside, below = _SLACK, _SLACK
            left, top = whole_x - half - beside, whole_y - half - below
            read(values, here, left, top, 2 * (half + 1 + _SLACK), line, pixels)
        weights = weights_of(x - whole_x, y - whole_y)
        bx, by = _mismatch(pixels, below * line + beside, line, weights, window, gx, gy)
        step_x = (yy * bx - xy * by) / determinant
        step_y = (xx * by - xy * bx) / determinant
        share = relaxed(share, step_x, step_y, before_x, before_y)
        x, y = x - share * step_x, y - share * step_y
        if step_x * step_x + step_y * step_y < tolerance * tolerance:
            break
        before_x, before_y = step_x, step_y
    return x, y, _within(here, x, y)


@sum_kernel
def _normal_matrix(gx, gy):
    """Second moments of the gradients: xx, xy, yy."""
    zero = np.float32(0.0)
    xx, xy, yy = zero, zero, zero
    for i in range(np.uintp(len(gx))):
        xx += gx[i] * gx[i]
        xy += gx[i] * gy[i]
        yy += gy[i] * gy[i]
    return float(xx), float(xy), float(yy)


@sum_kernel
def _mismatch(pixels, begin, line, weights, window, gx, gy):
    """Sums of gradient times second image minus first, for a window that begins at a pixel."""
    bx, by = np.float32(0.0), np.float32(0.0)
    first = np.uintp(begin)
    for i in range(np.uintp(len(window))):
        difference = value_at(pixels, first + i, line, weights) - window[i]
        bx += difference * gx[i]
        by += difference * gy[i]
    return float(bx), float(by)
