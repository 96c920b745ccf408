"""Are the numbers of a result file ones that a run can have written?

A file may have been edited or damaged; what is computed from it must not overflow.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

__all__ = ["check_covariance", "check_size", "is_index"]

_LARGEST, _LEAST_VARIANCE = 1e100, 1e-100
_MOST = 2**53  # up to which a float holds whole numbers


def is_index(number: float) -> bool:
    """Whether a number counts something."""
    return 0 <= number < _MOST and number == int(number)


def check_size(numbers: Iterable[float]) -> None:
    """Raise ValueError where a number is infinite or as good as that; NaN stands for none."""
    for number in numbers:
        if abs(number) > _LARGEST:
            raise ValueError(f"expected a number of at most {_LARGEST:g}, got {number!r}")


def check_covariance(covariance: np.ndarray) -> None:
    """Raise ValueError where (..., D, D) is neither all NaN, for none, nor numbers of a size.

    Whether it is positive definite is for whoever uses it to find out.
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
