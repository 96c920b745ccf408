"""Pyramidal Lucas-Kanade tracking with the gradients of the first image.

A pyramid is one flat array of bytes. Each row of the layout describes a level: index of pixel (0,
0), stride from one line to the next, width and height. Around every level there is a border at
least as wide as `border_px`, so that a window whose centre is in the image needs no bounds check.

Templates, gradients and pixels of the second image have lines of the same length, so that a window
is contiguous in memory. Between the last column of the window and the end of a line, gradients and
weights are zero. Floats are float32, as in `affine_match`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.compile import inlined_kernel, inner_kernel, kernel, step_kernel, sum_kernel
from farpoint._kernels.constants import VECTOR_LANES
from farpoint.tracks.constants import WINDOW_SLACK_PX
from farpoint.tracks.kernels.windows import (
    Image,
    Termination,
    Weights,
    Window,
    blank_values,
    blank_window,
    differentiate,
    line_px,
    read,
    relaxed_share,
    room_px,
    sample,
    value_at,
    weights_of,
)

__all__ = ["Levels", "Workspace", "blank_workspace", "border_px", "follow_windows"]


class Levels(NamedTuple):
    """The levels of a pyramid that are searched."""

    values: np.ndarray
    """(V,) uint8, the pyramid."""
    layout: np.ndarray
    """(L, 4) int64, the finest level first."""


class Workspace(NamedTuple):
    """Buffers that are used for one window after the other."""

    pixels: np.ndarray
    """Pixels of an image around the window."""
    patch: np.ndarray
    """Interpolated values of the window and of one more pixel on each side."""
    window: Window
    """Window of the first image, with lines as long as those of the other buffers."""


def blank_workspace(half: int) -> Workspace:
    """Buffers for windows that are ``2 half + 1`` pixels wide."""
    width = 2 * half + 1
    reach = width + 1 + 2 * int(WINDOW_SLACK_PX)
    line = line_px(reach)
    return Workspace(
        blank_values(room_px(reach, line)),
        blank_values(room_px(width + 2, line)),
        blank_window(half, line),
    )


def border_px(half: int) -> int:
    """Least width of the border around each level for windows ``2 half + 1`` pixels wide."""
    return 2 * half + VECTOR_LANES + 4


@kernel
def follow_windows(
    levels0: Levels,
    levels1: Levels,
    points0: np.ndarray,
    start: np.ndarray,
    termination: Termination,
    back: float,
    space: Workspace,
    points1: np.ndarray,
) -> None:
    """Track windows from the first image to the second image, and backward.

    Each pass starts at the coarsest level and ends at the finest. The backward pass starts at
    ``points0 + (points1 - start)``: the initial errors of both passes have the same length.

    Parameters
    ----------
    levels0, levels1 : Levels
        Levels of both images, with the same layout.
    points0 : ndarray of float64, shape (N, 2)
        Centres of the windows in the first image, px.
    start : ndarray of float64, shape (N, 2)
        Initial centres in the second image, px.
    termination : Termination
        Criterion that ends the iterations at every level, in px of the level.
    back : float
        Upper bound of the forward-backward error, px.
    space : Workspace
        Buffers for this size of window.
    points1 : ndarray of float64, shape (N, 2)
        Out: centres of the windows in the second image. NaN if the finest level has no result
        because the window has no texture or leaves the image, or if the forward-backward error
        exceeds the bound.
    """
    for k in range(len(points0)):
        x0, y0 = points0[k]
        from_x, from_y = start[k]
        points1[k] = np.nan
        x, y, found = _find(levels0, levels1, (x0, y0), (from_x, from_y), termination, space)
        if found:
            from_x, from_y = x + x0 - from_x, y + y0 - from_y
            x0_again, y0_again, found = _find(
                levels1, levels0, (x, y), (from_x, from_y), termination, space
            )
            if found and math.hypot(x0_again - x0, y0_again - y0) <= back:
                points1[k, 0], points1[k, 1] = x, y


@inlined_kernel
def _find(
    levels0: Levels,
    levels1: Levels,
    point0: tuple[float, float],
    start: tuple[float, float],
    termination: Termination,
    space: Workspace,
) -> tuple[float, float, bool]:
    """Position, in the second image, of the window around ``point0``, and whether it is valid."""
    window, layout = space.window, levels0.layout
    width, line = 2 * window.half + 3, window.line
    scale = 0.5 ** (len(layout) - 1)
    x, y = start[0] * scale, start[1] * scale
    found = False
    for k in range(len(layout) - 1, -1, -1):
        place, stride, columns, rows = layout[k, 0], layout[k, 1], layout[k, 2], layout[k, 3]
        image0 = Image(levels0.values, place, stride, columns, rows)
        image1 = Image(levels1.values, place, stride, columns, rows)
        left, top = point0[0] * scale, point0[1] * scale
        found = _within(image0, left, top)
        if found:
            left, top = left - window.half - 1, top - window.half - 1
            sample(image0, left, top, width, line, space.pixels, space.patch)
            differentiate(space.patch, line, window)
            _project_out_brightness(window)
            x1, y1, found = _descend(image1, x, y, termination, space)
            if found:
                x, y = x1, y1
        if k > 0:
            scale, x, y = 2.0 * scale, 2.0 * x, 2.0 * y
    return x, y, found


@inner_kernel
def _within(image: Image, x: float, y: float) -> bool:
    """Whether a pixel is in the image; False for NaN."""
    return 0.0 <= x <= image.width - 1.0 and 0.0 <= y <= image.height - 1.0


@step_kernel
def _descend(
    image: Image, x: float, y: float, termination: Termination, space: Workspace
) -> tuple[float, float, bool]:
    """Take Gauss-Newton steps on one level from (x, y).

    The function returns the last position and whether the position is valid. The position is
    invalid if the window has no texture or if a step leaves the image.
    """
    window, pixels = space.window, space.pixels
    half, line = window.half, window.line
    xx, xy, yy = _normal_matrix(window.gx, window.gy)
    determinant = xx * yy - xy * xy
    if not determinant > 1e-6 * xx * yy:  # no gradients, or all in one direction
        return x, y, False
    before_x, before_y, share = 0.0, 0.0, 1.0
    left, top = 0, 0
    for step in range(termination.iterations):
        if not _within(image, x, y):
            return x, y, False
        whole_x, whole_y = math.floor(x), math.floor(y)
        beside, below = whole_x - half - left, whole_y - half - top
        if step == 0 or not (
            0 <= beside <= 2 * WINDOW_SLACK_PX and 0 <= below <= 2 * WINDOW_SLACK_PX
        ):
            beside, below = WINDOW_SLACK_PX, WINDOW_SLACK_PX
            left, top = whole_x - half - beside, whole_y - half - below
            read(image, left, top, 2 * (half + 1 + WINDOW_SLACK_PX), line, pixels)
        weights = weights_of(x - whole_x, y - whole_y)
        bx, by = _mismatch(pixels, below * line + beside, weights, window)
        step_x = (yy * bx - xy * by) / determinant
        step_y = (xx * by - xy * bx) / determinant
        share = relaxed_share(share, step_x, step_y, before_x, before_y)
        x, y = x - share * step_x, y - share * step_y
        if step_x * step_x + step_y * step_y < termination.tolerance * termination.tolerance:
            break
        before_x, before_y = step_x, step_y
    return x, y, _within(image, x, y)


@step_kernel
def _project_out_brightness(window: Window) -> None:
    """Make the gradients orthogonal to a change of gain and offset over the window.

    A change of gain or offset between the images then does not contribute to the sums of gradient
    times difference of the images. The displacement is therefore the same as by least squares with
    gain and offset as further unknowns ("project out": G. Hager, P. Belhumeur, PAMI 1998,
    doi:10.1109/34.722606). This method takes one pass over each window instead of one pass per
    step.
    """
    grey, gx, gy, inside = window.grey, window.gx, window.gy, window.inside
    count = np.float32((2 * window.half + 1) ** 2)
    mean = _sum_of_products(grey, inside) / count
    mean_x, mean_y = _sum_of_products(gx, inside) / count, _sum_of_products(gy, inside) / count
    square, along_x, along_y = _brightness_moments(window, mean)
    none = np.float32(0.0)
    gain_x = along_x / square if square > none else none
    gain_y = along_y / square if square > none else none
    for i in range(np.uintp(len(grey))):
        contrast = grey[i] - mean
        gx[i] -= inside[i] * (mean_x + gain_x * contrast)
        gy[i] -= inside[i] * (mean_y + gain_y * contrast)


@sum_kernel
def _sum_of_products(a: np.ndarray, b: np.ndarray) -> np.floating:
    total = np.float32(0.0)
    for i in range(np.uintp(len(a))):
        total += a[i] * b[i]
    return total


@sum_kernel
def _brightness_moments(
    window: Window, mean: np.floating
) -> tuple[np.floating, np.floating, np.floating]:
    """Sums of ``c c``, ``c gx`` and ``c gy`` over the window, with ``c = grey - mean``."""
    grey, gx, gy, inside = window.grey, window.gx, window.gy, window.inside
    zero = np.float32(0.0)
    square, along_x, along_y = zero, zero, zero
    for i in range(np.uintp(len(grey))):
        contrast = inside[i] * (grey[i] - mean)
        square += contrast * contrast
        along_x += contrast * gx[i]
        along_y += contrast * gy[i]
    return square, along_x, along_y


@sum_kernel
def _normal_matrix(gx: np.ndarray, gy: np.ndarray) -> tuple[float, float, float]:
    """Second moments of the gradients: xx, xy, yy."""
    zero = np.float32(0.0)
    xx, xy, yy = zero, zero, zero
    for i in range(np.uintp(len(gx))):
        xx += gx[i] * gx[i]
        xy += gx[i] * gy[i]
        yy += gy[i] * gy[i]
    return float(xx), float(xy), float(yy)


@sum_kernel
def _mismatch(
    pixels: np.ndarray, begin: int, weights: Weights, window: Window
) -> tuple[float, float]:
    """Sums over the window of gradient times (second image - first image).

    ``begin`` is the index, in ``pixels``, at which the window of the second image begins.
    """
    line, grey, gx, gy = window.line, window.grey, window.gx, window.gy
    bx, by = np.float32(0.0), np.float32(0.0)
    first = np.uintp(begin)
    for i in range(np.uintp(len(grey))):
        difference = value_at(pixels, first + i, line, weights) - grey[i]
        bx += difference * gx[i]
        by += difference * gy[i]
    return float(bx), float(by)
