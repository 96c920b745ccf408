"""Sub-pixel matching of image windows under an affine warp and a change of brightness.

For every pixel ``w = (u, v)`` of a window, counted from its centre, the model is::

    I1(p1 + d + (I + M) w) = (1 + gain) (I0(p0 + w) - mean) + mean + offset

I0 and I1 are the images, p0 is the point in I0, p1 is the initial point in I1, and ``mean`` is the
mean of I0 over the window. The eight parameters are ``theta = [d (2), M by rows (4), gain,
offset]``. All parameters except ``d`` have a Gaussian prior. Gauss-Newton uses the gradients of the
first image, transformed by the expected warp, so that the normal matrix is computed only once
(Baker and Matthews, "Lucas-Kanade 20 Years On", IJCV 56, 2004).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.arrays import copy
from farpoint._kernels.compile import kernel, step_kernel
from farpoint.tracks.constants import AFFINE_PARAMETERS
from farpoint.tracks.kernels.affine_jacobian import (
    Nine,
    Template,
    blank_template,
    jacobian_products,
    jacobian_times,
    linearise,
    normal_matrix,
)
from farpoint.tracks.kernels.warped_window import Around, blank_around, residual_of
from farpoint.tracks.kernels.window_covariance import (
    Influence,
    blank_influence,
    covary,
    find_influence,
    quadratic_bias,
    respond,
    solve,
)
from farpoint.tracks.kernels.windows import (
    Image,
    Termination,
    blank_values,
    differentiate,
    line_px,
    relaxed_share,
    room_px,
    sample,
)

__all__ = ["Matched", "ParameterPrior", "Workspace", "blank_workspace", "match_windows"]


class ParameterPrior(NamedTuple):
    """Gaussian prior of the parameters."""

    precision: np.ndarray
    """(8,) inverse variance of each parameter; 0 without a prior."""
    noise_floor: float
    """Lower bound of the variance of the residual, grey levels^2."""


class Matched(NamedTuple):
    """Matches and statistics of the matches."""

    points: np.ndarray
    """(N, 2) pixels in the second image. In: initial pixels. Out: matched pixels."""
    warps: np.ndarray
    """(N, 2, 2) warps ``I + M``. In: initial warps and means of the prior. Out: matched warps."""
    covariances: np.ndarray
    """(N, 2, 2) covariance of the point, px^2; NaN without a match, because the window leaves an
    image or has no texture."""
    correlations: np.ndarray
    """(N,) correlation of the two windows, -1 to 1."""
    quadratic_bias: np.ndarray
    """(N, 2, 2, 3) bias of the match by quadratic motion, px; see `Windows.quadratic_bias`."""
    responses: np.ndarray
    """(N, 2, 2) response of the match to a displacement of the second image; see
    `window_covariance.respond`."""


class Workspace(NamedTuple):
    """Buffers that are used for one match after the other."""

    pixels: np.ndarray
    """Pixels of the first image around the window."""
    patch: np.ndarray
    """Interpolated values of the window and of one more pixel on each side."""
    patch_line: int
    """Stride from one line to the next of ``pixels`` and ``patch``."""
    template: Template
    around: Around
    """Pixels of the second image around the window."""
    residual: np.ndarray
    """(S + 2 lines,) residual: second image minus first."""
    predicted: np.ndarray
    """(S,) change of the residual that the last step predicts."""
    normal: np.ndarray
    """(8, 8) normal matrix."""
    factor: np.ndarray
    """(8, 8) lower Cholesky factor of the normal matrix, with the diagonal inverted."""
    expected: np.ndarray
    """(8,) mean of the prior of the parameters."""
    theta: np.ndarray
    """(8,) parameters."""
    step: np.ndarray
    """(8,) step of the parameters."""
    influence: Influence


def blank_workspace(half: int) -> Workspace:
    """Buffers to match windows that are ``2 half + 1`` pixels wide."""
    width = 2 * half + 1
    patch_line = line_px(width + 3)
    template = blank_template(half)
    size = len(template.u)
    square = (AFFINE_PARAMETERS, AFFINE_PARAMETERS)
    return Workspace(
        pixels=blank_values(room_px(width + 3, patch_line)),
        patch=blank_values(room_px(width + 2, patch_line)),
        patch_line=patch_line,
        template=template,
        around=blank_around(half),
        residual=blank_values(size + 2 * template.window.line),
        predicted=blank_values(size),
        normal=np.zeros(square),
        factor=np.zeros(square),
        expected=np.zeros(AFFINE_PARAMETERS),
        theta=np.zeros(AFFINE_PARAMETERS),
        step=np.zeros(AFFINE_PARAMETERS),
        influence=blank_influence(half),
    )


@kernel
def match_windows(
    image0: Image,
    image1: Image,
    points0: np.ndarray,
    parameter_prior: ParameterPrior,
    termination: Termination,
    space: Workspace,
    matched: Matched,
) -> None:
    """Refine the matches of the points ``points0`` (N, 2), px, and fill all fields of ``matched``.

    On input, ``matched`` holds the initial points and warps.
    """
    points1, warps, template, theta = matched.points, matched.warps, space.template, space.theta
    for k in range(len(points0)):
        matched.covariances[k] = np.nan
        matched.correlations[k] = 0.0
        _expect(warps[k], space.expected)
        if not _take_template(image0, points0[k], space):
            continue
        x, y = points1[k]
        variance, correlation = _fit(image1, (x, y), parameter_prior, termination, space)
        if variance < 0.0:
            continue
        points1[k, 0], points1[k, 1] = x + theta[0], y + theta[1]
        warps[k, 0, 0], warps[k, 0, 1] = 1.0 + theta[2], theta[3]
        warps[k, 1, 0], warps[k, 1, 1] = theta[4], 1.0 + theta[5]
        matched.correlations[k] = correlation
        influence, precision = space.influence, parameter_prior.precision
        find_influence(space.factor, template, influence)
        quadratic_bias(template, influence, matched.quadratic_bias[k])
        covariance = matched.covariances[k]
        covary(template, space.residual, variance, precision, influence, covariance)
        respond(template, space.residual, theta, influence, matched.responses[k])


@step_kernel
def _expect(warp: np.ndarray, expected: np.ndarray) -> None:
    """Write the elements of a warp ``I + M`` to the warp parameters of ``expected`` (8,)."""
    expected[2], expected[3] = warp[0, 0] - 1.0, warp[0, 1]
    expected[4], expected[5] = warp[1, 0], warp[1, 1] - 1.0


@step_kernel
def _take_template(image: Image, point: np.ndarray, space: Workspace) -> bool:
    """Read the window around a point of the first image; False if the window leaves the image."""
    template, patch_line, half = space.template, space.patch_line, space.template.window.half
    x, y, width = point[0] - half - 1, point[1] - half - 1, 2 * half + 3
    if not _holds(image, x, y, width):
        return False
    sample(image, x, y, width, patch_line, space.pixels, space.patch)
    differentiate(space.patch, patch_line, template.window)
    linearise(template, space.expected)
    normal_matrix(template, space.normal)
    return True


@step_kernel
def _holds(image: Image, x: float, y: float, width: int) -> bool:
    """Whether the image contains all pixels of a window whose first pixel is (x, y)."""
    left, top = math.floor(x), math.floor(y)  # in compiled code, floor(NaN) is negative
    return left >= 0 and top >= 0 and left + width < image.width and top + width < image.height


@step_kernel
def _fit(
    image: Image,
    start: tuple[float, float],
    parameter_prior: ParameterPrior,
    termination: Termination,
    space: Workspace,
) -> tuple[float, float]:
    """Fit the parameters by Gauss-Newton iteration.

    The function returns the variance of the residual, at least the noise floor, and the correlation
    of the two windows. The variance is -1 without a match.
    """
    (x, y), precision = start, parameter_prior.precision
    template, residual, predicted = space.template, space.residual, space.predicted
    normal, factor, expected = space.normal, space.factor, space.expected
    theta, step = space.theta, space.step
    count = (2 * template.window.half + 1) ** 2
    copy(expected, theta)
    variance, correlation = -1.0, 0.0
    before_x, before_y, share = 0.0, 0.0, 1.0
    for _ in range(termination.iterations):
        if not residual_of(image, x, y, template, theta, space.around, residual):
            return -1.0, 0.0
        sums = jacobian_products(template, residual)
        # The information of the prior is relative to the noise variance, which the residual gives.
        variance = max(sums[8] / count, parameter_prior.noise_floor)
        if not _factorise(normal, precision, variance, factor):
            return -1.0, 0.0
        correlation = _correlation(normal[6, 6], sums, theta[6], count)
        for a in range(AFFINE_PARAMETERS):
            step[a] = sums[a] + variance * precision[a] * (theta[a] - expected[a])
        solve(factor, step)
        share = relaxed_share(share, step[0], step[1], before_x, before_y)
        before_x, before_y = step[0], step[1]
        for a in range(AFFINE_PARAMETERS):
            theta[a] -= share * step[a]
        if step[0] * step[0] + step[1] * step[1] < termination.tolerance * termination.tolerance:
            break
    # Residual after the last step, to first order.
    jacobian_times(template, step, predicted)
    for i in range(np.uintp(len(predicted))):
        residual[i] -= predicted[i]
    return variance, correlation


@step_kernel
def _factorise(
    normal: np.ndarray, precision: np.ndarray, variance: float, factor: np.ndarray
) -> bool:
    """Lower Cholesky factor of the normal matrix with the priors.

    The result is False if the matrix is not positive definite. On the diagonal, the reciprocals of
    the elements of the factor are stored, because the elements are only used as divisors.
    """
    for a in range(AFFINE_PARAMETERS):
        for b in range(a + 1):
            total = normal[a, b] + (variance * precision[a] if a == b else 0.0)
            for c in range(b):
                total -= factor[a, c] * factor[b, c]
            if b < a:
                factor[a, b] = total * factor[b, b]
            elif total <= 1e-6 * normal[a, a] or not total > 0.0:  # singular within float32 sums
                return False
            else:
                factor[a, a] = 1.0 / math.sqrt(total)
    return True


@step_kernel
def _correlation(contrast_square: float, sums: Nine, gain: float, count: int) -> float:
    """Correlation of the template with the warped window, from the residual of the match.

    ``sums`` are the residual's `jacobian_products`.
    """
    mean = -sums[7] / count
    cross = (1.0 + gain) * contrast_square - sums[6]
    square = (1.0 + gain) ** 2 * contrast_square - 2.0 * (1.0 + gain) * sums[6]
    square += sums[8] - count * mean * mean
    if contrast_square <= 0.0 or square <= 0.0:
        return 0.0
    return cross / math.sqrt(contrast_square * square)
