"""Points followed from image to image: Lucas-Kanade with the gradients of the first, by pyramids.

A pyramid is one flat array of bytes; a row of its layout tells where a level lies in it: the place
of the level's pixel (0, 0), the places from one line to the next, width and height. Around every
level there is a border at least as wide as `border_px`, so that a window whose centre is in the
image needs no look at where the image ends.

Lines of a window are as long as the processor likes them, `LANES` pixels or a multiple: what lies
beyond the window has no gradient, and no weight by that. Floats are float32, as in `affine_match`.
"""

from __future__ import annotations

import numpy as np

from farpoint._kernels.compile import inner_kernel, kernel, sum_kernel
from farpoint._kernels.windows import LANES, between, differentiate, line_px, sample, value_at

__all__ = ["border_px", "follow_windows"]


def border_px(half: int) -> int:
    """How wide the border around each level must be for windows of ``2 half + 1`` pixels."""
    return 2 * half + LANES + 4


@kernel
def follow_windows(values0, values1, layout, points0, start, half, iterations, tolerance, points1):
    """Find windows of one image in another, from the coarsest level to the finest.

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
    points1 : ndarray of float64, shape (N, 2)
        Out: centres of the windows in the second image; NaN where the finest level has no answer:
        no texture, or no place within the image.
    """
    width = 2 * half + 1
    line, patch_line = line_px(width), line_px(width + 2)
    patch = np.zeros((width + 2) * patch_line + LANES, np.float32)
    window, gx, gy = (
        np.zeros(width * line, np.float32),
        np.zeros(width * line, np.float32),
        np.zeros(width * line, np.float32),
    )
    weight = np.zeros(line, np.float32)
    weight[:width] = 1.0
    for k in range(len(points0)):
        scale = 0.5 ** (len(layout) - 1)
        x, y = start[k, 0] * scale, start[k, 1] * scale
        seen = False
        for level in range(len(layout) - 1, -1, -1):
            here = layout[level]
            x0, y0 = points0[k, 0] * scale, points0[k, 1] * scale
            seen = False
            if _within(here, x0, y0):
                sample(values0, here, x0 - half - 1, y0 - half - 1, width + 2, patch_line, patch)
                differentiate(patch, patch_line, width, line, weight, window, gx, gy)
                x1, y1, seen = _descend(
                    values1, here, x, y, half, line, window, gx, gy, iterations, tolerance
                )
                if seen:
                    x, y = x1, y1
            if level > 0:
                scale, x, y = 2.0 * scale, 2.0 * x, 2.0 * y
        points1[k, 0], points1[k, 1] = (x, y) if seen else (np.nan, np.nan)


@inner_kernel
def _within(here, x, y):
    """Whether a pixel is in the image; NaN is not."""
    return 0.0 <= x <= here[2] - 1.0 and 0.0 <= y <= here[3] - 1.0


@inner_kernel
def _descend(values, here, x, y, half, line, window, gx, gy, iterations, tolerance):
    """Gauss-Newton steps on one level from (x, y); whether they stayed in the image."""
    xx, xy, yy = _normal_matrix(gx, gy)
    determinant = xx * yy - xy * xy
    if not determinant > 1e-6 * xx * yy:  # no texture, or along one direction only
        return x, y, False
    before_x, before_y = 0.0, 0.0
    for _ in range(iterations):
        if not _within(here, x, y):
            return x, y, False
        bx, by = _mismatch(values, here, x - half, y - half, 2 * half + 1, line, window, gx, gy)
        step_x = (yy * bx - xy * by) / determinant
        step_y = (xx * by - xy * bx) / determinant
        x, y = x - step_x, y - step_y
        if step_x * step_x + step_y * step_y < tolerance * tolerance:
            break
        if abs(step_x + before_x) < 0.01 and abs(step_y + before_y) < 0.01:
            # To and fro: the middle.
            x, y = x + 0.5 * step_x, y + 0.5 * step_y
            break
        before_x, before_y = step_x, step_y
    return x, y, _within(here, x, y)


@sum_kernel
def _normal_matrix(gx, gy):
    """Second moments of the gradients: xx, xy, yy."""
    zero = np.float32(0.0)
    xx, xy, yy = zero, zero, zero
    for begin in range(0, len(gx), LANES):
        i = np.uintp(begin)
        for j in range(np.uintp(LANES)):
            xx += gx[i + j] * gx[i + j]
            xy += gx[i + j] * gy[i + j]
            yy += gy[i + j] * gy[i + j]
    return float(xx), float(xy), float(yy)


@sum_kernel
def _mismatch(values, here, x, y, rows, line, window, gx, gy):
    """Sums of gradient times second image minus first, for a window that begins at (x, y)."""
    place, weights = between(here, x, y)
    stride = np.uintp(here[1])
    bx, by = np.float32(0.0), np.float32(0.0)
    for v in range(rows):
        for begin in range(0, line, LANES):
            i, out = np.uintp(place + v * here[1] + begin), np.uintp(v * line + begin)
            for j in range(np.uintp(LANES)):
                difference = value_at(values, i + j, stride, weights) - window[out + j]
                bx += difference * gx[out + j]
                by += difference * gy[out + j]
    return float(bx), float(by)
