"""Checks of what a user gives: pixels or rays, cameras, and covariances."""

from __future__ import annotations

import numpy as np

from farpoint._kernels.pairs import is_finite
from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.geometry.vectors import median
from farpoint.pose.constants import ISOTROPIC, VARIANCE_BOUNDS_PX2, VARIANCE_RATIO_BOUNDS

__all__ = ["check_camera", "checked_rows", "relative_covariances"]


def check_camera(name: str, camera: object) -> None:
    """Raise an InputError if the argument ``name`` is not a camera."""
    if not isinstance(camera, Camera):
        raise InputError(f"expected a Camera, got {type(camera).__name__}", field=name)


def checked_rows(
    name: str, values: np.ndarray, shape: tuple[int, ...], rows: int | None = None
) -> np.ndarray:
    """The values as finite C-ordered float64 of shape (rows, *shape), or an InputError."""
    try:
        given = np.asarray(values)
    except ValueError as error:  # rows of different lengths
        raise InputError(f"expected numbers of shape {_shape(rows, shape)}", field=name) from error
    if given.shape == (0,):  # an empty list, whose rows have no length
        given = np.empty((0, *shape))
    if given.dtype.kind not in "iuf" and given.size:
        raise InputError(
            f"expected real numbers of shape {_shape(rows, shape)}, got {given.dtype}", field=name
        )
    array = np.ascontiguousarray(given, dtype=np.float64)
    if array.ndim != 1 + len(shape) or array.shape[1:] != shape or rows not in (None, len(array)):
        raise InputError(f"expected shape {_shape(rows, shape)}, got {array.shape}", field=name)
    if not is_finite(array.reshape(-1)):
        raise InputError("expected finite numbers, got NaN or infinite ones", field=name)
    return array


def _shape(rows: int | None, shape: tuple[int, ...]) -> str:
    return f"({'N' if rows is None else rows}, {', '.join(map(str, shape))})"


def relative_covariances(
    count: int, covariance0_px2: np.ndarray | None, covariance1_px2: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Covariances of both images, divided by the median variance of all given covariances.

    The shape is (N, 2, 2), or (1, 2, 2) for an image without given covariances.
    """
    if covariance0_px2 is None and covariance1_px2 is None:
        return ISOTROPIC, ISOTROPIC
    first = _checked_covariance("covariance0_px2", covariance0_px2, count)
    is_shared = covariance0_px2 is covariance1_px2
    second = first
    if not is_shared:
        second = _checked_covariance("covariance1_px2", covariance1_px2, count)
    # The variances are divided by their median and not by their mean: after division by a mean that
    # one huge variance dominates, all other covariances would be nearly 0.
    different = (first,) if is_shared else (first, second)
    traces = [c[:, 0, 0] + c[:, 1, 1] for c in different if c is not None]
    typical = max(median(np.concatenate(traces)) / 2.0 if count else 1.0, 1e-300)
    first = _relative(first, typical)
    return first, first if is_shared else _relative(second, typical)


def _relative(covariances: np.ndarray | None, typical: float) -> np.ndarray:
    """Covariances divided by a typical variance; isotropic if there are none."""
    if covariances is None:
        return ISOTROPIC
    return _bounded(covariances / typical, *VARIANCE_RATIO_BOUNDS)


def _bounded(covariances: np.ndarray, least: float, most: float) -> np.ndarray:
    """Covariances whose variances are limited to the range from ``least`` to about ``most``.

    With variances outside the range, squares and quotients would overflow, or all matches but one
    with a tiny variance would have no weight.
    """
    xx, yy = covariances[:, 0, 0], covariances[:, 1, 1]
    highest = np.maximum(xx, yy)
    far = (np.minimum(xx, yy) < least) | (highest > most)
    if not far.any():
        return covariances
    scale = most / np.maximum(highest[far], most)
    bounded = covariances.copy()
    bounded[far] = scale[:, None, None] * covariances[far] + least * ISOTROPIC
    return bounded


def _checked_covariance(name: str, covariance: np.ndarray | None, count: int) -> np.ndarray | None:
    """Positive definite covariances (N, 2, 2), px^2, with bounded variances; None without any."""
    if covariance is None:
        return None
    C = checked_rows(name, covariance, (2, 2), rows=count)
    xx, xy, yx, yy = C.reshape(-1, 4).T
    if not (np.abs(xy - yx) <= 1e-6 * np.abs(xy) + 1e-8).all():
        raise InputError("expected symmetric matrices", field=name)
    # The test compares square roots, because products of large variances overflow.
    if not ((xx > 0.0) & (yy > 0.0)).all() or not (np.abs(xy) < np.sqrt(xx) * np.sqrt(yy)).all():
        raise InputError("expected positive definite matrices", field=name)
    return _bounded(C, *VARIANCE_BOUNDS_PX2)
