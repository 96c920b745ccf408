"""Covariance of a matched window from its residual, and bias of the match by quadratic motion."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.compile import inner_kernel, step_kernel, sum_kernel
from farpoint._kernels.constants import VECTOR_LANES
from farpoint.tracks.constants import AFFINE_PARAMETERS, GRADIENT_NOISE_RATIO, RESIDUAL_BLOCK_PX
from farpoint.tracks.kernels.affine_jacobian import Template, jacobian_times
from farpoint.tracks.kernels.windows import line_px

__all__ = [
    "Influence",
    "blank_influence",
    "covary",
    "find_influence",
    "quadratic_bias",
    "respond",
    "solve",
]


class Influence(NamedTuple):
    """Influence of the residual of each pixel on the estimated displacement of a match."""

    rows: np.ndarray
    """(2, 8) the two rows of the inverse normal matrix that belong to the displacement."""
    pixels: np.ndarray
    """(2, S) derivative of the displacement by the residual of each pixel, px per grey level: rows
    times Jacobian."""
    moves: np.ndarray
    """(2, R) ``pixels`` times residual for each pixel, px, with a border of zeros."""
    line: int
    """Stride from one line of ``moves`` to the next."""


def blank_influence(half: int) -> Influence:
    """Buffers for the influence in a window that is ``2 half + 1`` pixels wide."""
    width, around = 2 * half + 1, 2 * half + 1 + 2 * (RESIDUAL_BLOCK_PX - 1)
    line = line_px(around)
    pixels = np.zeros((2, width * line_px(width)), np.float32)
    moves = np.zeros((2, around * line + VECTOR_LANES), np.float32)
    return Influence(np.zeros((2, AFFINE_PARAMETERS)), pixels, moves, line)


@inner_kernel
def solve(factor: np.ndarray, vector: np.ndarray) -> None:
    """Solve ``F @ F.T @ x = vector`` in place. The diagonal of F is stored inverted."""
    for a in range(AFFINE_PARAMETERS):
        for b in range(a):
            vector[a] -= factor[a, b] * vector[b]
        vector[a] *= factor[a, a]
    for a in range(AFFINE_PARAMETERS - 1, -1, -1):
        for b in range(a + 1, AFFINE_PARAMETERS):
            vector[a] -= factor[b, a] * vector[b]
        vector[a] *= factor[a, a]


@step_kernel
def find_influence(factor: np.ndarray, template: Template, influence: Influence) -> None:
    """Fill the fields ``rows`` and ``pixels`` of ``influence``."""
    rows, pixels = influence.rows, influence.pixels
    rows[:] = 0.0
    for a in range(2):
        rows[a, a] = 1.0
        solve(factor, rows[a])
        jacobian_times(template, rows[a], pixels[a])


@step_kernel
def quadratic_bias(template: Template, influence: Influence, bias: np.ndarray) -> None:
    """Fill ``bias`` (2, 2, 3): bias of a match due to quadratic motion; see `Windows`.

    Quadratic motion is not part of the affine model. A displacement ``q(w)`` of the pixel w
    decreases the residual of the pixel by ``gradient . q``.
    """
    for a in range(2):
        sums = _quadratic_moves(template, influence.pixels[a])
        for b in range(2):
            for c in range(3):
                bias[a, b, c] = sums[3 * b + c]


@sum_kernel
def _quadratic_moves(template: Template, influence: np.ndarray) -> tuple:
    """Sums over the window of ``influence * g * q``, g = gx, gy and q = u u, u v, v v."""
    gx, gy, us, vs = template.window.gx, template.window.gy, template.u, template.v
    zero = np.float32(0.0)
    xuu, xuv, xvv, yuu, yuv, yvv = zero, zero, zero, zero, zero, zero
    for i in range(np.uintp(len(influence))):
        u, v = us[i], vs[i]
        along, down = influence[i] * gx[i], influence[i] * gy[i]
        xuu += along * u * u
        xuv += along * u * v
        xvv += along * v * v
        yuu += down * u * u
        yuv += down * u * v
        yvv += down * v * v
    return float(xuu), float(xuv), float(xvv), float(yuu), float(yuv), float(yvv)


@step_kernel
def covary(
    template: Template,
    residual: np.ndarray,
    variance: float,
    prior: np.ndarray,
    influence: Influence,
    covariance: np.ndarray,
) -> None:
    """Sandwich covariance (2, 2) of the displacement, from products of influence and residual.

    Neighbouring residuals are correlated because of interpolation, blur and errors of the model.
    The products are therefore summed over every block of 3 x 3 pixels, and the sums are squared.
    This is the estimate of Newey and West (1987) in two dimensions, with triangular weights up to a
    lag of 2 px. The estimate is positive semi-definite by construction.
    """
    half, line = template.window.half, template.window.line
    rows, pixels, moves = influence.rows, influence.pixels, influence.moves
    width, margin, moves_line = 2 * half + 1, RESIDUAL_BLOCK_PX - 1, influence.line
    for a in range(2):
        for v in range(width):
            i, out = np.uintp(v * line), np.uintp((v + margin) * moves_line + margin)
            for j in range(np.uintp(line)):
                moves[a, out + j] = pixels[a, i + j] * residual[i + j]
    xx, xy, yy = _block_moments(moves, moves_line, (width + margin) * moves_line)
    # Correction for degrees of freedom: count / block^2 independent blocks minus half the number
    # of parameters.
    count = width * width
    blocks = count / RESIDUAL_BLOCK_PX**2
    scale = blocks / (blocks - AFFINE_PARAMETERS / 2.0)
    covariance[0, 0] = scale * xx
    covariance[0, 1] = scale * xy
    covariance[1, 1] = scale * yy
    # The priors of M, gain and offset contribute to the covariance of the displacement.
    for a in range(2):
        for b in range(a, 2):
            for c in range(AFFINE_PARAMETERS):
                covariance[a, b] += rows[a, c] * rows[b, c] * variance * prior[c]
    covariance[1, 0] = covariance[0, 1]
    _undo_attenuation(rows, variance * count, covariance)


@sum_kernel
def _block_moments(moves: np.ndarray, line: int, size: int) -> tuple[float, float, float]:
    """Second moments (xx, xy, yy) of the sums of ``moves`` over blocks of 3 x 3 pixels.

    A second moment is the sum over all blocks of a grid, averaged over the 9 positions of the grid.
    """
    zero = np.float32(0.0)
    xx, xy, yy = zero, zero, zero
    one, two = np.uintp(1), np.uintp(2)
    for i in range(np.uintp(size)):
        j, k = i + np.uintp(line), i + np.uintp(2 * line)
        x = moves[0, i] + moves[0, i + one] + moves[0, i + two]
        x += moves[0, j] + moves[0, j + one] + moves[0, j + two]
        x += moves[0, k] + moves[0, k + one] + moves[0, k + two]
        y = moves[1, i] + moves[1, i + one] + moves[1, i + two]
        y += moves[1, j] + moves[1, j + one] + moves[1, j + two]
        y += moves[1, k] + moves[1, k + one] + moves[1, k + two]
        xx += x * x
        xy += x * y
        yy += y * y
    return (
        float(xx) / RESIDUAL_BLOCK_PX**2,
        float(xy) / RESIDUAL_BLOCK_PX**2,
        float(yy) / RESIDUAL_BLOCK_PX**2,
    )


@step_kernel
def respond(
    template: Template,
    residual: np.ndarray,
    theta: np.ndarray,
    influence: Influence,
    response: np.ndarray,
) -> None:
    """Response (2, 2): derivative of the estimated by the true displacement of the second image.

    The response is the sum, over the window, of influence times gradient of the second image. The
    gradient of the second image is ``1 + gain`` times the gradient of the template, plus the
    gradient of the residual. For the gradient of the template, the sum is the identity.
    """
    half, line = template.window.half, template.window.line
    width, pixels = 2 * half + 1, influence.pixels
    for v in range(width):
        residual[v * line + width : (v + 1) * line] = 0.0  # undefined before
    xu, xv, yu, yv = _gradient_products(pixels[0], pixels[1], residual, line, width)
    # From the axes of the window to those of the second image: inv(I + M).T times the gradient.
    a, b, c, d = 1.0 + theta[2], theta[3], theta[4], 1.0 + theta[5]
    scale, gain = 1.0 / (a * d - b * c), 1.0 + theta[6]
    response[0, 0], response[0, 1] = gain + scale * (d * xu - c * xv), scale * (a * xv - b * xu)
    response[1, 0], response[1, 1] = scale * (d * yu - c * yv), gain + scale * (a * yv - b * yu)


@inner_kernel
def _gradient_products(
    on_x: np.ndarray, on_y: np.ndarray, residual: np.ndarray, line: int, width: int
) -> tuple[float, float, float, float]:
    """Sums over the window of influence times the gradient of the residual.

    ``on_x`` and ``on_y`` are the influences on the x and the y coordinate of the displacement. The
    four sums are: ``on_x`` times the gradient to the right, ``on_x`` times the gradient downwards,
    and the same two sums for ``on_y``. The gradients are central differences, or one-sided
    differences at the border of the window.
    """
    xu, xv, yu, yv = _central_products(on_x, on_y, residual, line, width * line)
    half, bottom = np.float32(0.5), (width - 1) * line
    for v in range(width):
        i, j = v * line, v * line + width - 1  # the first and the last pixel of a line
        first, last = half * residual[i + 1] - residual[i], residual[j] - half * residual[j - 1]
        xu += on_x[i] * first + on_x[j] * last
        yu += on_y[i] * first + on_y[j] * last
    for u in range(width):
        i = bottom + u
        first, last = residual[u + line] - residual[u], residual[i] - residual[i - line]
        xv += on_x[u] * first + on_x[i] * last
        yv += on_y[u] * first + on_y[i] * last
    return float(xu), float(xv), float(yu), float(yv)


@sum_kernel
def _central_products(
    on_x: np.ndarray, on_y: np.ndarray, residual: np.ndarray, line: int, size: int
) -> tuple[np.floating, np.floating, np.floating, np.floating]:
    """The four sums of `_gradient_products` with central differences at all pixels.

    The residual is taken as 0 beyond the ends of a line. The first and the last line do not
    contribute to the sums with the gradient downwards.
    """
    zero, half, one = np.float32(0.0), np.float32(0.5), np.uintp(1)
    xu, xv, yu, yv, step = zero, zero, zero, zero, np.uintp(line)
    for i in range(one, np.uintp(size)):
        along = half * (residual[i + one] - residual[i - one])
        xu += on_x[i] * along
        yu += on_y[i] * along
    for i in range(step, np.uintp(size) - step):
        down = half * (residual[i + step] - residual[i - step])
        xv += on_x[i] * down
        yv += on_y[i] * down
    first = half * residual[1]
    return xu + on_x[0] * first, xv, yu + on_y[0] * first, yv


@step_kernel
def _undo_attenuation(rows: np.ndarray, power: float, covariance: np.ndarray) -> None:
    """Correct a covariance C for noise in the gradients, which makes the information too large.

    D (2, 2) is the information on the displacement, as the sum of products of gradients, and ``nu
    I`` is the part of D that is due to noise. ``nu`` is `GRADIENT_NOISE_RATIO` times ``power``, the
    sum of squared residuals, but at most 1/3 of the smallest eigenvalue of D, because only a part
    of a residual is noise. The corrected covariance is ``S C S`` with ``S = inv(D - nu I) D``.
    """
    # inv(D) is the displacement's block of the inverse normal matrix.
    mean = 0.5 * (rows[0, 0] + rows[1, 1])
    kth_largest = mean + math.hypot(0.5 * (rows[0, 0] - rows[1, 1]), rows[0, 1])
    nu = min(GRADIENT_NOISE_RATIO * power, 1.0 / (3.0 * kth_largest))
    # S = inv(I - nu inv(D))
    a, b, c = 1.0 - nu * rows[0, 0], -nu * rows[0, 1], 1.0 - nu * rows[1, 1]
    scale = 1.0 / (a * c - b * b)
    a, b, c = scale * c, -scale * b, scale * a
    p, q, r = covariance[0, 0], covariance[0, 1], covariance[1, 1]
    covariance[0, 0] = a * a * p + 2.0 * a * b * q + b * b * r
    covariance[0, 1] = a * b * p + (a * c + b * b) * q + b * c * r
    covariance[1, 0] = covariance[0, 1]
    covariance[1, 1] = b * b * p + 2.0 * b * c * q + c * c * r
