"""Exponential and logarithm that a processor can do for several numbers at once."""

from __future__ import annotations

from farpoint._kernels.formulas import exponent_and_mantissa, formula, lesser
from farpoint._kernels.fused import fused

__all__ = ["exp_and_roots", "lane_log"]

_LN2 = 0.6931471805599453
_SQRT2 = 1.4142135623730951


@formula
def exp_and_roots(x: float) -> tuple[float, float, float]:
    """``exp(-x)``, ``exp(-x / 8)`` and ``exp(-x / 64)`` for x >= 0; constant beyond x = 1920.

    The series at x / 2048, squared eleven, eight and five times; the relative errors are below 1e-9
    up to x = 50, 1e-6 up to x = 150, and beyond x = 1000, where even the last is next to nothing,
    worse than 1e-3.
    """
    y = lesser(x, 1920.0) * (1.0 / 2048.0)
    s = 1.0 / 120.0
    s = fused(-y, s, 1.0 / 24.0)
    s = fused(-y, s, 1.0 / 6.0)
    s = fused(-y, s, 0.5)
    s = fused(-y, s, 1.0)
    s = fused(-y, s, 1.0)
    s *= s
    s *= s
    s *= s
    s *= s
    s *= s
    eighth = s * s
    eighth *= eighth
    eighth *= eighth
    whole = eighth * eighth
    whole *= whole
    whole *= whole
    return whole, eighth, s


@formula
def lane_log(x: float) -> float:
    """``log(x)`` of a positive normal number, to 1e-8."""
    exponent, mantissa = exponent_and_mantissa(x)
    z = (mantissa - _SQRT2) / (mantissa + _SQRT2)
    y = z * z
    series = fused(y, fused(y, fused(y, fused(y, 2.0 / 9.0, 2.0 / 7.0), 0.4), 2.0 / 3.0), 2.0)
    return fused(exponent + 0.5, _LN2, z * series)
