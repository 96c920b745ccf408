"""Exponential and logarithm for vector instructions."""

from __future__ import annotations

from farpoint._kernels.compile import inlined_kernel
from farpoint._kernels.constants import LN2, SQRT2
from farpoint._kernels.scalars import exponent_and_mantissa, fma

__all__ = ["exp_and_roots", "lane_log"]


@inlined_kernel
def exp_and_roots(x: float) -> tuple[float, float, float, float]:
    """The powers 1, 1/8, 1/64 and 1/512 of ``exp(-x)``; constant for x beyond 15360.

    x must not be negative. The power series is evaluated at x / 65536. The result is squared seven
    times for the power 1/512, and three more times for each of the powers 1/64, 1/8 and 1. The
    relative errors are below 1e-9 up to x = 300, and below 1e-4 for every value that is not 0.
    """
    y = min(x, 15360.0) * (1.0 / 65536.0)
    s = 1.0 / 120.0
    s = fma(-y, s, 1.0 / 24.0)
    s = fma(-y, s, 1.0 / 6.0)
    s = fma(-y, s, 0.5)
    s = fma(-y, s, 1.0)
    s = fma(-y, s, 1.0)
    last = _to_the_eighth(_to_the_eighth(s))
    last *= last
    third = _to_the_eighth(last)
    second = _to_the_eighth(third)
    return _to_the_eighth(second), second, third, last


@inlined_kernel
def _to_the_eighth(x: float) -> float:
    square = x * x
    fourth = square * square
    return fourth * fourth


@inlined_kernel
def lane_log(x: float) -> float:
    """``log(x)`` of a positive normal number, to 1e-8."""
    exponent, mantissa = exponent_and_mantissa(x)
    z = (mantissa - SQRT2) / (mantissa + SQRT2)
    y = z * z
    series = fma(y, fma(y, fma(y, fma(y, 2.0 / 9.0, 2.0 / 7.0), 0.4), 2.0 / 3.0), 2.0)
    return fma(exponent + 0.5, LN2, z * series)
