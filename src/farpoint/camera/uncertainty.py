"""Uncertainty of a lens: sigmas of focal length, centre and distortion, or a covariance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from farpoint.camera.values import positive
from farpoint.errors import InputError

__all__ = ["CameraUncertainty", "covariance_factor"]

# Bounds for a correlation matrix. Eigenvalues up to RELATIVE_ZERO times the largest count as zero.
# ASYMMETRY bounds the difference between mirrored entries, and negative eigenvalues.
RELATIVE_ZERO = 1e-12
ASYMMETRY = 1e-6


@dataclass(frozen=True, kw_only=True)
class CameraUncertainty:
    """Errors of a calibration, 1 sigma: three common errors, or the covariance of the parameters.

    Attributes
    ----------
    focal : float or None
        Relative error of the focal length, common to x and y; None if exact.
    center_px : float or None
        Error of each coordinate of the principal point, px; None if exact.
    distortion_px : float or None
        Error of the distortion as the displacement at the corner of the image, px; None if exact.
    covariance : tuple of tuple of float, or None
        Covariance (P, P) of the parameters of the lens's ``refinable()``, in their units and order.
        No other attribute is allowed beside a covariance. A parameter with variance 0 is exact.

    Raises
    ------
    InputError
        For a number that is not positive, or a matrix that is no covariance. The message names the
        field.
    """

    focal: float | None = None
    center_px: float | None = None
    distortion_px: float | None = None
    covariance: tuple[tuple[float, ...], ...] | None = None

    def __post_init__(self) -> None:
        terms = ("focal", "center_px", "distortion_px")
        for name in terms:
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, positive(name, value))
        if self.covariance is not None:
            given = [name for name in terms if getattr(self, name) is not None]
            if given:
                raise InputError(f"expected none beside {given[0]}", field="covariance")
            object.__setattr__(self, "covariance", _checked(self.covariance))

    @classmethod
    def of_covariance(cls, covariance: np.ndarray) -> CameraUncertainty:
        """Uncertainty with this covariance (P, P) of the parameters."""
        return cls(covariance=_checked(covariance))


def covariance_factor(covariance: np.ndarray) -> np.ndarray:
    """A matrix ``F`` (P, r) of full rank with ``F @ F.T`` equal to the covariance (P, P).

    The parameters are ``given + F @ z`` with r independent numbers z of variance 1. The rows of
    exact parameters are zero. For a covariance of zeros, r is 0.
    """
    sigma = np.sqrt(np.diag(covariance))
    known = np.where(sigma > 0.0, sigma, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(known, known))
    kept = values > RELATIVE_ZERO * max(1.0, values.max(initial=0.0))
    return known[:, None] * vectors[:, kept] * np.sqrt(values[kept])


def _checked(covariance: Any) -> tuple[tuple[float, ...], ...]:
    """The matrix, made symmetric. A matrix that is no covariance raises an InputError."""
    try:
        matrix = np.array(covariance, dtype=np.float64)
    except (TypeError, ValueError):
        raise _fault("expected numbers of shape (P, P)") from None
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or matrix.size == 0:
        raise _fault(f"expected shape (P, P), got {matrix.shape}")
    if not np.isfinite(matrix).all():
        raise _fault("expected finite numbers")
    variances = np.diag(matrix)
    if np.any(variances < 0.0):
        raise _fault(f"expected no negative variance, got {variances.min():g}")
    sigma = np.sqrt(variances)
    scale = np.where(sigma > 0.0, sigma, 1.0)
    correlation = matrix / np.outer(scale, scale)
    if correlation[sigma == 0.0].any() or correlation[:, sigma == 0.0].any():
        raise _fault("expected a positive semi-definite matrix")
    if not np.abs(correlation - correlation.T).max() < ASYMMETRY:
        raise _fault("expected a symmetric matrix")
    if not np.linalg.eigvalsh(correlation).min() > -ASYMMETRY:
        raise _fault("expected a positive semi-definite matrix")
    return tuple(map(tuple, (0.5 * (matrix + matrix.T)).tolist()))


def _fault(problem: str) -> InputError:
    return InputError(problem, field="covariance")
