"""Sub-pixel matching of image windows under an affine warp and a change of brightness.

For every pixel ``w = (u, v)`` of a window, counted from its centre, the model is::

    I1(p1 + d + (I + M) w) = (1 + gain) (I0(p0 + w) - mean) + mean + offset

with the eight parameters ``theta = [d (2), M by rows (4), gain, offset]`` and a Gaussian prior on
all but ``d``. Gauss-Newton with the gradients of the first image, warped as expected, so that the
normal matrix is built once (Baker and Matthews, "Lucas-Kanade 20 Years On", IJCV 56, 2004).

With the gradients ``gx, gy`` and the contrast ``c = mean - I0``, a pixel's residual has the
derivatives ``[gx, gy, gx u, gx v, gy u, gy v, c, -1]``. Only what differs from pixel to pixel is
kept; the products are made where they are summed.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inlined_kernel, inner_kernel, kernel, sum_kernel
from farpoint._kernels.window_covariance import (
    PARAMETERS,
    bend,
    covary,
    influence_of,
    room_of,
    solve,
)
from farpoint._kernels.windows import LANES, differentiate, line_px, sample

__all__ = ["match_windows"]


@kernel
def match_windows(
    values0,
    values1,
    here,
    points0,
    expected,
    half,
    prior,
    noise_floor,
    iterations,
    tolerance,
    points1,
    covariance,
    correlation,
    warps,
    bending,
):
    """Refine ``points1`` in place and say how certain they are.

    Parameters
    ----------
    values0, values1 : ndarray of uint8, shape (V,)
        Both images.
    here : ndarray of int64, shape (4,)
        Where they lie in these; see `farpoint._kernels.windows`.
    points0 : ndarray of float64, shape (N, 2)
        Centres of the windows in the first image, px.
    expected : ndarray of float64, shape (N, 8)
        Prior mean of the parameters, and where they begin; the displacement's is zero.
    half : int
        Windows are ``2 half + 1`` pixels wide and high.
    prior : ndarray of float64, shape (8,)
        Inverse prior variance of each parameter; 0 for no prior.
    noise_floor : float
        The variance of the residual is at least this, grey levels^2.
    iterations : int
        Gauss-Newton steps at most.
    tolerance : float
        Stop when a step moves the point by less, px.
    points1 : ndarray of float64, shape (N, 2)
        In: start. Out: the match.
    covariance : ndarray of float64, shape (N, 2, 2)
        Out: covariance of ``points1``, px^2; NaN where there is no match (window outside an
        image, no texture).
    correlation : ndarray of float64, shape (N,)
        Out: correlation of the two windows at the match, -1 to 1; 0 where there is no match.
    warps : ndarray of float64, shape (N, 2, 2)
        Out: ``I + M`` of the match.
    bending : ndarray of float64, shape (N, 2, 2, 3)
        Out: what a motion that the model leaves out does to the match, px: ``[a, b, c]`` is the
        move along axis a for each unit of ``u^2``, ``u v`` or ``v^2`` (c) along axis b.
    """
    width = 2 * half + 1
    line, patch_line = line_px(width), line_px(width + 2)
    size = width * line
    patch = np.zeros((width + 2) * patch_line + LANES, np.float32)
    # u, v and the weight of each pixel
    grid = (np.zeros(size, np.float32), np.zeros(size, np.float32), np.zeros(size, np.float32))
    _number(half, line, grid)
    ahead = np.arange(LANES).astype(np.float32)
    # gx, gy and c
    slopes = (np.zeros(size, np.float32), np.zeros(size, np.float32), np.zeros(size, np.float32))
    template, residual = np.zeros(size, np.float32), np.zeros(size + LANES, np.float32)
    normal, factor = np.zeros((PARAMETERS, PARAMETERS)), np.zeros((PARAMETERS, PARAMETERS))
    theta, step = np.zeros(PARAMETERS), np.zeros(PARAMETERS)
    rows = np.zeros((2, PARAMETERS))
    influence = np.zeros((2, size), np.float32)
    moves = room_of(width)
    for k in range(len(points0)):
        covariance[k] = np.nan
        correlation[k] = 0.0
        x0, y0 = points0[k, 0] - half - 1, points0[k, 1] - half - 1
        if not _holds(here, x0, y0, width + 2):
            continue
        sample(values0, here, x0, y0, width + 2, patch_line, patch)
        differentiate(patch, patch_line, width, line, grid[2], template, slopes[0], slopes[1])
        _linearise(template, grid, expected[k], width * width, slopes)
        _normal_matrix(slopes, grid, normal)
        x, y = points1[k]
        theta[:] = expected[k]
        seen = True
        variance = noise_floor
        for _ in range(iterations):
            seen = _residual(
                values1, here, x, y, half, line, theta, ahead, template, slopes, residual
            )
            if not seen:
                break
            sums = _pulls(slopes, grid, residual)
            # The prior weighs as much as the noise tells it to; the residual shows the noise.
            variance = max(sums[8] / (width * width), noise_floor)
            seen = _factorise(normal, prior, variance, factor)
            if not seen:
                break
            _step(factor, sums, prior, variance, expected[k], theta, step)
            if step[0] * step[0] + step[1] * step[1] < tolerance * tolerance:
                break
        if seen and _residual(
            values1, here, x, y, half, line, theta, ahead, template, slopes, residual
        ):
            points1[k, 0] = x + theta[0]
            points1[k, 1] = y + theta[1]
            sums = _pulls(slopes, grid, residual)
            correlation[k] = _correlation(normal[6, 6], sums, theta[6], width * width)
            warps[k, 0, 0], warps[k, 0, 1] = 1.0 + theta[2], theta[3]
            warps[k, 1, 0], warps[k, 1, 1] = theta[4], 1.0 + theta[5]
            influence_of(factor, slopes, grid, rows, influence)
            bend(slopes, grid, influence, bending[k])
            covary(rows, influence, residual, prior, variance, width, line, moves, covariance[k])


@inner_kernel
def _number(half, line, grid):
    """Places of a window's pixels, counted from its centre, and where it has any."""
    for v in range(2 * half + 1):
        for u in range(2 * half + 1):
            i = v * line + u
            grid[0][i], grid[1][i], grid[2][i] = u - half, v - half, 1.0


@inner_kernel
def _holds(here, x, y, width):
    """Whether the image has all pixels that a window which begins at (x, y) is made of."""
    left, top = math.floor(x), math.floor(y)  # of NaN, a negative number
    return left >= 0 and top >= 0 and left + width < here[2] and top + width < here[3]


@inner_kernel
def _linearise(template, grid, expected, count, slopes):
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


@sum_kernel
def _pulls(slopes, grid, values):
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
def _normal_matrix(slopes, grid, normal):
    """Lower triangle of the sums over the window of products of two derivatives."""
    _fill(_pulls(slopes, grid, slopes[0]), 0, 1.0, normal)
    _fill(_pulls(slopes, grid, slopes[1]), 1, 1.0, normal)
    _fill(_pulls(slopes, grid, slopes[2]), 6, 1.0, normal)
    _fill(_pulls(slopes, grid, grid[2]), 7, -1.0, normal)
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


@inner_kernel
def _factorise(normal, prior, variance, factor):
    """Lower Cholesky factor of the normal matrix with its prior; False if it has none.

    Its diagonal is inverted: what it is used for is to divide by.
    """
    for a in range(PARAMETERS):
        for b in range(a + 1):
            total = normal[a, b] + (variance * prior[a] if a == b else 0.0)
            for c in range(b):
                total -= factor[a, c] * factor[b, c]
            if b < a:
                factor[a, b] = total * factor[b, b]
            elif total <= 1e-6 * normal[a, a] or not total > 0.0:  # singular within float32 sums
                return False
            else:
                factor[a, a] = 1.0 / math.sqrt(total)
    return True


@inner_kernel
def _residual(values, here, x, y, half, line, theta, ahead, template, slopes, residual):
    """Second image, warped, minus the brightness-corrected template; False if it leaves it."""
    reach_x = half * (abs(1.0 + theta[2]) + abs(theta[3]))
    reach_y = half * (abs(theta[4]) + abs(1.0 + theta[5]))
    x += theta[0]
    y += theta[1]
    # Written so that a NaN is outside too.
    if not (reach_x <= x < here[2] - 1 - reach_x and reach_y <= y < here[3] - 1 - reach_y):
        return False
    _read(values, here, x, y, half, theta, ahead, line, residual)
    gain, offset = np.float32(theta[6]), np.float32(theta[7])
    for i in range(np.uintp(len(template))):
        residual[i] += gain * slopes[2][i] - template[i] - offset
    return True


@inner_kernel
def _read(values, here, x, y, half, theta, u, line, out):
    """Values of a window around (x, y) between pixels, warped; beyond its lines anything.

    Seen from a pixel that moves on as if there were no warp, pixels side by side need the same
    neighbours as long as the warp moves them by a pixel at most. So many are read in one step;
    `LANES` are written each time, and what is wrong of these is overwritten by the next step.
    """
    step = LANES
    while (step - 1) * max(abs(theta[2]), abs(theta[4])) > 1.0:
        step //= 2
    drift_x, drift_y = (step - 1) * min(theta[2], 0.0), (step - 1) * min(theta[4], 0.0)
    for v in range(2 * half + 1):
        for part in range(0, 2 * half + 1, step):
            px = x + theta[3] * (v - half) + (1.0 + theta[2]) * (part - half)
            py = y + (1.0 + theta[5]) * (v - half) + theta[4] * (part - half)
            left, top = math.floor(px + drift_x), math.floor(py + drift_y)
            place = here[0] + top * here[1] + left
            from_x, from_y = np.float32(px - left), np.float32(py - top)
            _read_part(values, place, here[1], from_x, from_y, theta, u, v * line + part, out)


@inlined_kernel
def _read_part(values, place, stride, x, y, theta, u, begin, out):
    """Values between three by three pixels that move on along a line, in steps as warped.

    Between these pixels, values go up or down along straight lines.

    Parameters
    ----------
    place : int
        In ``values``, of the one at the upper left.
    x, y : float32
        Place of the first value from there on, 0 to 2 px.
    """
    zero, one = np.float32(0.0), np.float32(1.0)
    xu, yu = np.float32(theta[2]), np.float32(theta[4])
    o, i = np.uintp(begin), np.uintp(place)
    k, m = i + np.uintp(stride), i + np.uintp(2 * stride)
    for j in range(np.uintp(LANES)):
        to_x, to_y = x + xu * u[j], y + yu * u[j]
        a, b = min(to_x, one), max(to_x - one, zero)
        row0 = _along(values, i + j, a, b)
        row1 = _along(values, k + j, a, b)
        row2 = _along(values, m + j, a, b)
        a, b = min(to_y, one), max(to_y - one, zero)
        out[o + j] = row0 + a * (row1 - row0) + b * (row2 - row1)


@inlined_kernel
def _along(values, i, a, b):
    """Value at ``a + b`` pixels to the right of the i-th."""
    left, middle = np.float32(values[i]), np.float32(values[i + np.uintp(1)])
    right = np.float32(values[i + np.uintp(2)])
    return left + a * (middle - left) + b * (right - middle)


@inner_kernel
def _step(factor, sums, prior, variance, expected, theta, step):
    """Take a Gauss-Newton step, ``theta -= step``, given the factor of the normal matrix."""
    for a in range(PARAMETERS):
        step[a] = sums[a] + variance * prior[a] * (theta[a] - expected[a])
    solve(factor, step)
    for a in range(PARAMETERS):
        theta[a] -= step[a]


@inner_kernel
def _correlation(contrast_square, sums, gain, count):
    """Correlation of the template with the warped window, from the residual of the match.

    ``sums`` are the residual's `_pulls`.
    """
    mean = -sums[7] / count
    cross = (1.0 + gain) * contrast_square - sums[6]
    square = (1.0 + gain) ** 2 * contrast_square - 2.0 * (1.0 + gain) * sums[6]
    square += sums[8] - count * mean * mean
    if contrast_square <= 0.0 or square <= 0.0:
        return 0.0
    return cross / math.sqrt(contrast_square * square)
