"""Sub-pixel matching of image windows under an affine warp and a change of brightness.

For every pixel ``w = (u, v)`` of a window, counted from its centre, the model is::

    I1(p1 + d + (I + M) w) = (1 + gain) (I0(p0 + w) - mean) + mean + offset

with the eight parameters ``theta = [d (2), M by rows (4), gain, offset]`` and a Gaussian prior on
all but ``d``. Gauss-Newton with the gradients of the first image, warped as expected, so that the
normal matrix is built once (Baker and Matthews, "Lucas-Kanade 20 Years On", IJCV 56, 2004).
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.affine_slopes import (
    PARAMETERS,
    changes,
    linearise,
    normal_matrix,
    number,
    pulls,
)
from farpoint._kernels.compile import inner_kernel, kernel
from farpoint._kernels.warped_window import pixels_for, residual_of
from farpoint._kernels.window_covariance import bend, covary, influence_of, room_of, solve
from farpoint._kernels.windows import differentiate, line_px, relaxed, room_px, sample

__all__ = ["match_windows"]


@kernel
def match_windows(
    values0, values1, here, points0, half, prior, noise_floor, iterations, tolerance, matches
):
    """Refine matches in place and say how certain they are.

    Parameters
    ----------
    values0, values1 : ndarray of uint8, shape (V,)
        Both images.
    here : ndarray of int64, shape (4,)
        Where they lie in these; see `farpoint._kernels.windows`.
    points0 : ndarray of float64, shape (N, 2)
        Centres of the windows in the first image, px.
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
    matches : tuple of ndarray of float64
        Points in the second image (N, 2), px, and warps ``I + M`` (N, 2, 2): in, where to begin,
        which for the warp is the prior's mean too; out, the match. And what is told of it: the
        covariance (N, 2, 2) of the point, px^2, NaN where there is no match (window outside an
        image, no texture); the correlation (N,) of the two windows, -1 to 1; and what a motion that
        the model leaves out does to the match (N, 2, 2, 3), px: ``[a, b, c]`` is the move along
        axis a for each unit of ``u^2``, ``u v`` or ``v^2`` (c) along axis b.
    """
    points1, warps, covariances, correlations, bendings = matches
    width = 2 * half + 1
    line, patch_line = line_px(width), line_px(width + 3)
    size = width * line
    pixels = np.zeros(room_px(width + 3, patch_line), np.float32)
    patch = np.zeros(room_px(width + 2, patch_line), np.float32)
    grid = (np.zeros(size, np.float32), np.zeros(size, np.float32), np.zeros(size, np.float32))
    number(half, line, grid)
    slopes = (np.zeros(size, np.float32), np.zeros(size, np.float32), np.zeros(size, np.float32))
    window = (
        np.zeros(size, np.float32),  # of the first image
        np.zeros(size + 2 * line, np.float32),  # of the second, less the first
        pixels_for(half),
        np.zeros(size, np.float32),
    )
    normal, factor = np.zeros((PARAMETERS, PARAMETERS)), np.zeros((PARAMETERS, PARAMETERS))
    theta, expected = np.zeros(PARAMETERS), np.zeros(PARAMETERS)
    rows, influence = np.zeros((2, PARAMETERS)), np.zeros((2, size), np.float32)
    moves = room_of(width)
    for k in range(len(points0)):
        covariances[k] = np.nan
        correlations[k] = 0.0
        x0, y0 = points0[k, 0] - half - 1, points0[k, 1] - half - 1
        if not _holds(here, x0, y0, width + 2):
            continue
        sample(values0, here, x0, y0, width + 2, patch_line, pixels, patch)
        differentiate(patch, patch_line, width, line, grid[2], window[0], slopes[0], slopes[1])
        expected[2], expected[3] = warps[k, 0, 0] - 1.0, warps[k, 0, 1]
        expected[4], expected[5] = warps[k, 1, 0], warps[k, 1, 1] - 1.0
        linearise(window[0], grid, expected, width * width, slopes)
        normal_matrix(slopes, grid, normal)
        x, y = points1[k]
        variance, correlation = _fit(
            values1,
            here,
            (x, y),
            half,
            (prior, expected, noise_floor),
            (iterations, tolerance),
            (window, slopes, grid),
            (normal, factor),
            theta,
        )
        if variance < 0.0:
            continue
        points1[k, 0], points1[k, 1] = x + theta[0], y + theta[1]
        correlations[k] = correlation
        warps[k, 0, 0], warps[k, 0, 1] = 1.0 + theta[2], theta[3]
        warps[k, 1, 0], warps[k, 1, 1] = theta[4], 1.0 + theta[5]
        influence_of(factor, slopes, grid, rows, influence)
        bend(slopes, grid, influence, bendings[k])
        covary(rows, influence, window[1], prior, variance, width, line, moves, covariances[k])


@inner_kernel
def _holds(here, x, y, width):
    """Whether the image has all pixels that a window which begins at (x, y) is made of."""
    left, top = math.floor(x), math.floor(y)  # of NaN, a negative number
    return left >= 0 and top >= 0 and left + width < here[2] and top + width < here[3]


@inner_kernel
def _fit(values, here, start, half, belief, patience, parts, equations, theta):
    """Gauss-Newton steps to the parameters.

    Returns the residual's variance and the correlation of the windows; a variance of -1 where there
    is no match.
    """
    x, y = start
    prior, expected, noise_floor = belief
    iterations, tolerance = patience
    (template, residual, around, explained), slopes, grid = parts
    normal, factor = equations
    count = (2 * half + 1) ** 2
    step = np.zeros(PARAMETERS)
    theta[:] = expected
    variance, correlation = -1.0, 0.0
    before_x, before_y, share = 0.0, 0.0, 1.0
    for _ in range(iterations):
        if not residual_of(values, here, x, y, half, template, slopes[2], theta, around, residual):
            return -1.0, 0.0
        sums = pulls(slopes, grid, residual)
        # The prior weighs as much as the noise tells it to; the residual shows the noise.
        variance = max(sums[8] / count, noise_floor)
        if not _factorise(normal, prior, variance, factor):
            return -1.0, 0.0
        correlation = _correlation(normal[6, 6], sums, theta[6], count)
        for a in range(PARAMETERS):
            step[a] = sums[a] + variance * prior[a] * (theta[a] - expected[a])
        solve(factor, step)
        share = relaxed(share, step[0], step[1], before_x, before_y)
        before_x, before_y = step[0], step[1]
        for a in range(PARAMETERS):
            theta[a] -= share * step[a]
        if step[0] * step[0] + step[1] * step[1] < tolerance * tolerance:
            break
    # What is left once the last step is taken; its gradients say how much that is.
    changes(slopes, grid, step, explained)
    for i in range(np.uintp(len(explained))):
        residual[i] -= explained[i]
    return variance, correlation


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
