"""Sub-pixel refinement of matches, and the covariance of each match."""

from __future__ import annotations

import numpy as np

from farpoint.tracks.constants import INTERPOLATION_SIGMA_PX, MIN_RESPONSE
from farpoint.tracks.kernels.affine_match import (
    Matched,
    ParameterPrior,
    blank_workspace,
    match_windows,
)
from farpoint.tracks.kernels.windows import Termination
from farpoint.tracks.options import RefinementOptions
from farpoint.tracks.pyramid import Pyramid
from farpoint.tracks.tracks import Windows

__all__ = ["refine", "window_reach"]


def window_reach(options: RefinementOptions) -> int:
    """Least distance of a window's centre from the image border, px; includes the gradients."""
    return options.window_px // 2 + 2


def refine(
    image0: Pyramid,
    image1: Pyramid,
    points0: np.ndarray,
    points1: np.ndarray,
    options: RefinementOptions,
    warps: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, Windows]:
    """Refine positions in ``image1`` to sub-pixel precision, and estimate their covariances.

    A window is matched under an affine warp, a gain and an offset, and each of the three has a
    normal prior. Without the warp, matches on surfaces that approach or rotate have errors of 0.1
    px. On real drives the warp reduces epipolar residuals by about 40 %.

    The covariance C is the sandwich estimate ``H^-1 M H^-1``. H is the normal matrix of the
    window's gradients and of the priors. M is the second moment of the products of gradient and
    residual. The products are first summed over blocks of pixels, because residuals of neighbouring
    pixels are correlated. The contributions of the priors and of the interpolation are added.

    If the second image is blurred more or less than the first, the gradients of the second image
    differ from the gradients in H. The response R (2, 2), the derivative of the estimated
    displacement by the true displacement, then differs from the identity. R is computed from both
    windows of each match. With the median R of all matches, ``inv(R) C inv(R).T`` replaces C.

    Parameters
    ----------
    image0, image1 : Pyramid
        Pyramids of images of one size; only the finest levels are used.
    points0 : ndarray of float64, shape (N, 2)
        Pixels in ``image0``.
    points1 : ndarray of float64, shape (N, 2)
        Pixels in ``image1``, accurate to about 1 px.
    options : RefinementOptions
        Window, priors and limits.
    warps : ndarray of float64, shape (N, 2, 2), optional
        Expected derivatives of ``points1`` by ``points0``: initial warps and means of the prior of
        the warps. Default: identity.

    Returns
    -------
    points1 : ndarray of float64, shape (N, 2)
        Pixels in ``image1``.
    covariance_px2 : ndarray of float64, shape (N, 2, 2)
        Covariance of ``points1`` if ``points0`` is exact, px^2; NaN without a match.
    found : ndarray of bool, shape (N,)
        Whether there is a match whose correlation and shift are within the limits of ``options``.
    windows : Windows
        Affine warps of the windows, and biases of the matches due to quadratic motion.
    """
    count = len(points0)
    matched = np.array(points1, dtype=np.float64)
    shapes = np.broadcast_to(np.eye(2), (count, 2, 2)) if warps is None else warps
    windows = Windows(warps=np.array(shapes, order="C"), quadratic_bias=np.empty((count, 2, 2, 3)))
    covariance_px2, correlation = np.empty((count, 2, 2)), np.empty(count)
    responses = np.empty((count, 2, 2))
    match_windows(
        image0.level(0),
        image1.level(0),
        np.ascontiguousarray(points0, dtype=np.float64),
        ParameterPrior(_precision(options), options.noise_floor**2),
        Termination(options.max_iterations, options.tolerance_px),
        blank_workspace(options.window_px // 2),
        Matched(
            matched, windows.warps, covariance_px2, correlation, windows.quadratic_bias, responses
        ),
    )
    found = (correlation >= options.min_correlation) & np.isfinite(covariance_px2[:, 0, 0])
    found &= np.linalg.norm(matched - points1, axis=1) <= options.max_shift_px
    covariance_px2 = _with_response(covariance_px2, responses[found])
    covariance_px2 += INTERPOLATION_SIGMA_PX**2 * np.eye(2)
    return matched, covariance_px2, found, windows


def _precision(options: RefinementOptions) -> np.ndarray:
    """Inverse prior variances (8,): displacement (2, zero), warp (4), gain and offset."""
    sigma = [np.inf] * 2 + [options.affine_sigma] * 4 + [options.gain_sigma, options.offset_sigma]
    return 1.0 / np.square(sigma)


def _with_response(covariance_px2: np.ndarray, responses: np.ndarray) -> np.ndarray:
    """Covariances (N, 2, 2) of matches, corrected with the responses (M, 2, 2) of found matches.

    The response R is the derivative of the estimated displacement by the true displacement. If the
    blur changes between the images, R is not the identity, and the covariance of a match is
    ``inv(R) C inv(R).T`` instead of the given C. The effect of the blur on R is similar in all
    windows, while the R of a single window has a large error. The median R is therefore used for
    all matches.
    """
    if len(responses) == 0 or not np.isfinite(responses).all():
        return covariance_px2
    left, lengths, right = np.linalg.svd(np.median(responses, axis=0))
    inverse = right.T @ np.diag(1.0 / np.maximum(lengths, MIN_RESPONSE)) @ left.T
    both_sides = np.kron(inverse, inverse)  # faster than two products of many small matrices
    return (covariance_px2.reshape(-1, 4) @ both_sides.T).reshape(-1, 2, 2)
