"""Range checks of the numbers in a result file.

A file may have been edited or damaged; computations with its numbers must not overflow.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

__all__ = ["check_covariance", "check_size", "is_index"]

_LARGEST, _LEAST_VARIANCE = 1e100, 1e-100
_MOST = 2**53  # a float represents all whole numbers below this one


def is_index(number: float) -> bool:
    """Whether a number is a whole number in the range of an index."""
    return 0 <= number < _MOST and number == int(number)


def check_size(numbers: Iterable[float]) -> None:
    """Raise ValueError if a number is infinite or too large; NaN (no value) is allowed."""
    for number in numbers:
        if abs(number) > _LARGEST:
            raise ValueError(f"expected a number of at most {_LARGEST:g}, got {number!r}")


def check_covariance(covariance: np.ndarray) -> None:
    """Raise ValueError if a covariance (..., D, D) is NaN in part or has unusable numbers.

    An unusable number is too large, or is a variance too close to zero. If all elements are NaN,
    there is no covariance, and no error is raised. Positive definiteness is not checked.
    """
    undefined = np.isnan(covariance)
    if undefined.all():
        return
    if undefined.any():
        raise ValueError("expected a whole covariance, or none")
    variances = np.diagonal(covariance, axis1=-2, axis2=-1)
    tiny = (variances != 0.0) & (np.abs(variances) < _LEAST_VARIANCE)
    if tiny.any() or (np.abs(covariance) > _LARGEST).any():
        raise ValueError(
            f"expected variances from {_LEAST_VARIANCE:g} to {_LARGEST:g}, or 0 where held fixed"
        )
