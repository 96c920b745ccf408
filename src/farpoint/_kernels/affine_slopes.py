"""What a window's residual depends on: its derivatives by the parameters, and sums of products.

With the gradients ``gx, gy`` and the contrast ``c = mean - I0``, a pixel ``(u, v)`` of a window has
the derivatives ``[gx, gy, gx u, gx v, gy u, gy v, c, -1]`` by the parameters of `affine_match`.
Only what differs from pixel to pixel is kept (``slopes``: gx, gy and c); the products are made
where they are summed. ``grid`` is u, v, and 1 where the window has a pixel.
"""

from __future__ import annotations

import numpy as np

from farpoint._kernels.compile import inner_kernel, sum_kernel

__all__ = ["PARAMETERS", "changes", "linearise", "normal_matrix", "number", "pulls"]

PARAMETERS = 8


@inner_kernel
def number(half, line, grid):
    """Places of a window's pixels, counted from its centre, and where it has any."""
    for v in range(2 * half + 1):
        for u in range(2 * half + 1):
            i = v * line + u
            grid[0][i], grid[1][i], grid[2][i] = u - half, v - half, 1.0


@inner_kernel
def linearise(template, grid, expected, count, slopes):
    """Turn Scharr's gradients into the second image's, as expected, and set the contrast.

    These are ``inv(I + M).T`` times the first's.
    """
    a, b, c, d = 1.0 + expected[2], expected[3], expected[4], 1.0 + expected[5]
    scale = 1.0 / (a * d - b * c)
    xx, xy = np.float32(scale * d), np.float32(-scale * c)
    yx, yy = np.float32(-scale * b), np.float32(scale * a)
    mean = _dot(grid[2], template) / np.float32(count)
    for i in range(np.uintp(len(template))):
        dx, dy = slopes[0][i], slopes[1][i]
        slopes[0][i] = xx * dx + xy * dy
        slopes[1][i] = yx * dx + yy * dy
        slopes[2][i] = grid[2][i] * (mean - template[i])


@sum_kernel
def _dot(a, b):
    total = np.float32(0.0)
    for i in range(np.uintp(len(a))):
        total += a[i] * b[i]
    return total


@inner_kernel
def changes(slopes, grid, step, out):
    """What every pixel changes by where the parameters do: its derivatives times a step of them."""
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
        u, v = grid[0][i], grid[1][i]
        along = slopes[0][i] * (x + xu * u + xv * v) + slopes[1][i] * (y + yu * u + yv * v)
        out[i] = along + c * slopes[2][i] - w * grid[2][i]


@sum_kernel
def pulls(slopes, grid, values):
    """Derivatives times values, summed over the window; and last the sum of the values' squares."""
    zero = np.float32(0.0)
    x, y, xu, xv, yu, yv, c, w, square = zero, zero, zero, zero, zero, zero, zero, zero, zero
    for i in range(np.uintp(len(slopes[0]))):
        value, u, v = values[i], grid[0][i], grid[1][i]
        along, down = slopes[0][i] * value, slopes[1][i] * value
        x += along
        y += down
        xu += along * u
        xv += along * v
        yu += down * u
        yv += down * v
        c += slopes[2][i] * value
        w += grid[2][i] * value
        square += grid[2][i] * value * value
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
def _spreads(slopes, grid):
    """Products of the derivatives by M, summed: xu xu, xu xv, xv xv, xu yu, ... yv yv."""
    zero = np.float32(0.0)
    a, b, c, d, e, f, g, h, k = zero, zero, zero, zero, zero, zero, zero, zero, zero
    for i in range(np.uintp(len(slopes[0]))):
        xu, xv = slopes[0][i] * grid[0][i], slopes[0][i] * grid[1][i]
        yu, yv = slopes[1][i] * grid[0][i], slopes[1][i] * grid[1][i]
        a += xu * xu
        b += xu * xv
        c += xv * xv
        d += xu * yu
        e += xu * yv  # and xv yu
        f += xv * yv
        g += yu * yu
        h += yu * yv
        k += yv * yv
    return float(a), float(b), float(c), float(d), float(e), float(f), float(g), float(h), float(k)


@inner_kernel
def normal_matrix(slopes, grid, normal):
    """Lower triangle of the sums over the window of products of two derivatives."""
    _fill(pulls(slopes, grid, slopes[0]), 0, 1.0, normal)
    _fill(pulls(slopes, grid, slopes[1]), 1, 1.0, normal)
    _fill(pulls(slopes, grid, slopes[2]), 6, 1.0, normal)
    _fill(pulls(slopes, grid, grid[2]), 7, -1.0, normal)
    xuxu, xuxv, xvxv, xuyu, xuyv, xvyv, yuyu, yuyv, yvyv = _spreads(slopes, grid)
    normal[2, 2], normal[3, 2], normal[3, 3] = xuxu, xuxv, xvxv
    normal[4, 2], normal[4, 3], normal[5, 2], normal[5, 3] = xuyu, xuyv, xuyv, xvyv
    normal[4, 4], normal[5, 4], normal[5, 5] = yuyu, yuyv, yvyv


@inner_kernel
def _fill(sums, a, sign, normal):
    """Set row and column ``a``."""
    for b in range(PARAMETERS):
        normal[a, b] = sign * sums[b]
        normal[b, a] = normal[a, b]
