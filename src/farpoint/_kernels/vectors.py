"""Vectors (3,) and matrices (3, 3) as tuples, which compiled code keeps in registers."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inlined_kernel, kernel
from farpoint._kernels.scalars import fma

__all__ = [
    "Matrix",
    "Vector",
    "axpby",
    "cross",
    "dot",
    "matrix",
    "norm",
    "rotate",
    "rotate_back",
    "tangent_columns",
    "vector",
]

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]


@inlined_kernel
def vector(a: np.ndarray) -> Vector:
    """The elements of an array (3,)."""
    return a[0], a[1], a[2]


@inlined_kernel
def matrix(A: np.ndarray) -> Matrix:
    """The rows of an array (3, 3)."""
    return (
        (A[0, 0], A[0, 1], A[0, 2]),
        (A[1, 0], A[1, 1], A[1, 2]),
        (A[2, 0], A[2, 1], A[2, 2]),
    )


@inlined_kernel
def dot(a: Vector, b: Vector) -> float:
    """``a . b``."""
    return fma(a[0], b[0], fma(a[1], b[1], a[2] * b[2]))


@inlined_kernel
def norm(a: Vector) -> float:
    """``|a|``."""
    return math.sqrt(dot(a, a))


@inlined_kernel
def cross(a: Vector, b: Vector) -> Vector:
    """``a x b``."""
    return (
        fma(a[1], b[2], -(a[2] * b[1])),
        fma(a[2], b[0], -(a[0] * b[2])),
        fma(a[0], b[1], -(a[1] * b[0])),
    )


@inlined_kernel
def axpby(s: float, a: Vector, u: float, b: Vector) -> Vector:
    """``s a + u b``."""
    return fma(s, a[0], u * b[0]), fma(s, a[1], u * b[1]), fma(s, a[2], u * b[2])


@inlined_kernel
def rotate(R: Matrix, a: Vector) -> Vector:
    """``R a``."""
    return dot(R[0], a), dot(R[1], a), dot(R[2], a)


@inlined_kernel
def rotate_back(R: Matrix, a: Vector) -> Vector:
    """``R^T a``."""
    return (
        fma(R[0][0], a[0], fma(R[1][0], a[1], R[2][0] * a[2])),
        fma(R[0][1], a[0], fma(R[1][1], a[1], R[2][1] * a[2])),
        fma(R[0][2], a[0], fma(R[1][2], a[1], R[2][2] * a[2])),
    )


@kernel
def tangent_columns(d: Vector) -> tuple[Vector, Vector]:
    """Orthonormal basis perpendicular to the unit vector ``d`` (Duff et al., JCGT 2017)."""
    sign = math.copysign(1.0, d[2])
    a = -1.0 / (sign + d[2])
    b = d[0] * d[1] * a
    first = (1.0 + sign * d[0] * d[0] * a, sign * b, -sign * d[0])
    return first, (b, sign + d[1] * d[1] * a, -d[1])
