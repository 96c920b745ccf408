"""Vectors and matrices of three as tuples, which live in registers: the formulas' own words."""

from __future__ import annotations

import numpy as np

from farpoint._kernels.formulas import formula, root, with_sign_of
from farpoint._kernels.fused import fused

__all__ = [
    "Matrix",
    "Vector",
    "combine",
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


@formula
def vector(a: np.ndarray) -> Vector:
    """The elements of an array (3,)."""
    return a[0], a[1], a[2]


@formula
def matrix(A: np.ndarray) -> Matrix:
    """The rows of an array (3, 3)."""
    return (
        (A[0, 0], A[0, 1], A[0, 2]),
        (A[1, 0], A[1, 1], A[1, 2]),
        (A[2, 0], A[2, 1], A[2, 2]),
    )


@formula
def dot(a: Vector, b: Vector) -> float:
    """``a . b``."""
    return fused(a[0], b[0], fused(a[1], b[1], a[2] * b[2]))


@formula
def norm(a: Vector) -> float:
    """``|a|``."""
    return root(dot(a, a))


@formula
def cross(a: Vector, b: Vector) -> Vector:
    """``a x b``."""
    return (
        fused(a[1], b[2], -(a[2] * b[1])),
        fused(a[2], b[0], -(a[0] * b[2])),
        fused(a[0], b[1], -(a[1] * b[0])),
    )


@formula
def combine(s: float, a: Vector, u: float, b: Vector) -> Vector:
    """``s a + u b``."""
    return fused(s, a[0], u * b[0]), fused(s, a[1], u * b[1]), fused(s, a[2], u * b[2])


@formula
def rotate(R: Matrix, a: Vector) -> Vector:
    """``R a``."""
    return dot(R[0], a), dot(R[1], a), dot(R[2], a)


@formula
def rotate_back(R: Matrix, a: Vector) -> Vector:
    """``R^T a``."""
    return (
        fused(R[0][0], a[0], fused(R[1][0], a[1], R[2][0] * a[2])),
        fused(R[0][1], a[0], fused(R[1][1], a[1], R[2][1] * a[2])),
        fused(R[0][2], a[0], fused(R[1][2], a[1], R[2][2] * a[2])),
    )


@formula
def tangent_columns(d: Vector) -> tuple[Vector, Vector]:
    """Orthonormal basis perpendicular to the unit vector ``d`` (Duff et al., JCGT 2017)."""
    sign = with_sign_of(d[2], 1.0)
    a = -1.0 / (sign + d[2])
    b = d[0] * d[1] * a
    first = (1.0 + sign * d[0] * d[0] * a, sign * b, -sign * d[0])
    return first, (b, sign + d[1] * d[1] * a, -d[1])
