"""Jacobian of a window's residual by the affine parameters, and products with this Jacobian.

With the gradients ``gx, gy`` and the contrast ``c = mean - I0``, the residual of a pixel ``(u, v)``
of a window has the derivatives ``[gx, gy, gx u, gx v, gy u, gy v, c, -1]`` by the parameters of
`affine_match`. Only gx, gy, u, v and c are stored. The products are computed during summation.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from farpoint._kernels.compile import inner_kernel, step_kernel, sum_kernel
from farpoint.tracks.constants import AFFINE_PARAMETERS
from farpoint.tracks.kernels.windows import Window, blank_values, blank_window, line_px

__all__ = [
    "Template",
    "blank_template",
    "jacobian_products",
    "jacobian_times",
    "linearise",
    "normal_matrix",
]


Nine = tuple[float, float, float, float, float, float, float, float, float]


class Template(NamedTuple):
    """Window of the first image, with the factors of the residual's Jacobian."""

    window: Window
    """Window of the first image; after `linearise`, with gradients expected in the second image."""
    contrast: np.ndarray
    """(S,) mean of the window's values minus the value of each pixel."""
    u: np.ndarray
    """(S,) px to the right of the centre."""
    v: np.ndarray
    """(S,) px below the centre."""


def blank_template(half: int) -> Template:
    """Buffers of a template, with ``u`` and ``v`` already filled in."""
    width = 2 * half + 1
    window = blank_window(half, line_px(width))
    size = width * window.line
    u, v = blank_values(size), blank_values(size)
    for places, values in zip((v, u), np.mgrid[-half : half + 1, -half : half + 1], strict=True):
        places.reshape(width, -1)[:, :width] = values
    return Template(window, blank_values(size), u, v)


@step_kernel
def linearise(template: Template, expected: np.ndarray) -> None:
    """Predict the gradients of the second image, and set the contrast.

    The predicted gradients are ``inv(I + M).T`` times the Scharr gradients of the first image.
    ``expected`` (8,) are the prior means of the parameters of `affine_match`, with the warp
    ``I + M``.
    """
    window, contrast = template.window, template.contrast
    grey, gx, gy, inside = window.grey, window.gx, window.gy, window.inside
    a, b, c, d = 1.0 + expected[2], expected[3], expected[4], 1.0 + expected[5]
    scale = 1.0 / (a * d - b * c)
    xx, xy = np.float32(scale * d), np.float32(-scale * c)
    yx, yy = np.float32(-scale * b), np.float32(scale * a)
    mean = _dot(inside, grey) / np.float32((2 * window.half + 1) ** 2)
    for i in range(np.uintp(len(grey))):
        dx, dy = gx[i], gy[i]
        gx[i] = xx * dx + xy * dy
        gy[i] = yx * dx + yy * dy
        contrast[i] = inside[i] * (mean - grey[i])


@sum_kernel
def _dot(a: np.ndarray, b: np.ndarray) -> np.floating:
    total = np.float32(0.0)
    for i in range(np.uintp(len(a))):
        total += a[i] * b[i]
    return total


@inner_kernel
def jacobian_times(template: Template, step: np.ndarray, out: np.ndarray) -> None:
    """Jacobian times a step of the parameters: the predicted change of the residual (S,)."""
    window, contrast, us, vs = template.window, template.contrast, template.u, template.v
    gx, gy, inside = window.gx, window.gy, window.inside
    x, y, xu, xv = (
        np.float32(step[0]),
        np.float32(step[1]),
        np.float32(step[2]),
        np.float32(step[3]),
    )
    yu, yv, c, w = (
        np.float32(step[4]),
        np.float32(step[5]),
        np.float32(step[6]),
        np.float32(step[7]),
    )
    for i in range(np.uintp(len(out))):
        u, v = us[i], vs[i]
        along = gx[i] * (x + xu * u + xv * v) + gy[i] * (y + yu * u + yv * v)
        out[i] = along + c * contrast[i] - w * inside[i]


@sum_kernel
def jacobian_products(template: Template, values: np.ndarray) -> Nine:
    """Transposed Jacobian times values (S,), then, as ninth element, the sum of squared values."""
    window, contrast, us, vs = template.window, template.contrast, template.u, template.v
    gx, gy, inside = window.gx, window.gy, window.inside
    zero = np.float32(0.0)
    x, y, xu, xv, yu, yv, c, w, square = zero, zero, zero, zero, zero, zero, zero, zero, zero
    for i in range(np.uintp(len(gx))):
        value, u, v = values[i], us[i], vs[i]
        along, down = gx[i] * value, gy[i] * value
        x += along
        y += down
        xu += along * u
        xv += along * v
        yu += down * u
        yv += down * v
        c += contrast[i] * value
        w += inside[i] * value
        square += inside[i] * value * value
    return (
        float(x),
        float(y),
        float(xu),
        float(xv),
        float(yu),
        float(yv),
        float(c),
        -float(w),
        float(square),
    )


@sum_kernel
def _warp_products(template: Template) -> Nine:
    """Sums of products of the derivatives by the warp: xu xu, xu xv, xv xv, xu yu, ... yv yv."""
    gx, gy, us, vs = template.window.gx, template.window.gy, template.u, template.v
    zero = np.float32(0.0)
    a, b, c, d, e, f, g, h, k = zero, zero, zero, zero, zero, zero, zero, zero, zero
    for i in range(np.uintp(len(gx))):
        u, v = us[i], vs[i]
        xu, xv = gx[i] * u, gx[i] * v
        yu, yv = gy[i] * u, gy[i] * v
        a += xu * xu
        b += xu * xv
        c += xv * xv
        d += xu * yu
        e += xu * yv  # equal to xv * yu
        f += xv * yv
        g += yu * yu
        h += yu * yv
        k += yv * yv
    return float(a), float(b), float(c), float(d), float(e), float(f), float(g), float(h), float(k)


@step_kernel
def normal_matrix(template: Template, normal: np.ndarray) -> None:
    """Lower triangle of the normal matrix: sums over the window of products of two derivatives."""
    window = template.window
    _fill(jacobian_products(template, window.gx), 0, 1.0, normal)
    _fill(jacobian_products(template, window.gy), 1, 1.0, normal)
    _fill(jacobian_products(template, template.contrast), 6, 1.0, normal)
    _fill(jacobian_products(template, window.inside), 7, -1.0, normal)
    xuxu, xuxv, xvxv, xuyu, xuyv, xvyv, yuyu, yuyv, yvyv = _warp_products(template)
    normal[2, 2], normal[3, 2], normal[3, 3] = xuxu, xuxv, xvxv
    normal[4, 2], normal[4, 3], normal[5, 2], normal[5, 3] = xuyu, xuyv, xuyv, xvyv
    normal[4, 4], normal[5, 4], normal[5, 5] = yuyu, yuyv, yvyv


@inner_kernel
def _fill(sums: Nine, a: int, sign: float, normal: np.ndarray) -> None:
    """Set row and column ``a`` of the normal matrix."""
    for b in range(AFFINE_PARAMETERS):
        normal[a, b] = sign * sums[b]
        normal[b, a] = normal[a, b]
