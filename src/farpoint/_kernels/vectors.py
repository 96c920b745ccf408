"""Vectors of three as tuples: what the formulas are written in. They live in registers."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inner_kernel

__all__ = [
    "Vector",
    "column",
    "combine",
    "cross",
    "dot",
    "norm",
    "rotate",
    "rotate_back",
    "row",
    "vector",
]

Vector = tuple[float, float, float]


@inner_kernel
def vector(a: np.ndarray) -> Vector:
    """The elements of an array (3,)."""
    return a[0], a[1], a[2]


@inner_kernel
def row(a: np.ndarray, i: int) -> Vector:
    """Row ``i`` of an array (N, 3)."""
    return a[i, 0], a[i, 1], a[i, 2]


@inner_kernel
def column(a: np.ndarray, i: int, c: int) -> Vector:
    """Column ``c`` of matrix ``i`` of an array (N, 3, 2)."""
    return a[i, 0, c], a[i, 1, c], a[i, 2, c]


@inner_kernel
def dot(a: Vector, b: Vector) -> float:
    """``a . b``."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner_kernel
def norm(a: Vector) -> float:
    """``|a|``."""
    return math.sqrt(dot(a, a))


@inner_kernel
def cross(a: Vector, b: Vector) -> Vector:
    """``a x b``."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inner_kernel
def combine(s: float, a: Vector, u: float, b: Vector) -> Vector:
    """``s a + u b``."""
    return s * a[0] + u * b[0], s * a[1] + u * b[1], s * a[2] + u * b[2]


@inner_kernel
def rotate(R: np.ndarray, a: Vector) -> Vector:
    """``R a``."""
    return (
        R[0, 0] * a[0] + R[0, 1] * a[1] + R[0, 2] * a[2],
        R[1, 0] * a[0] + R[1, 1] * a[1] + R[1, 2] * a[2],
        R[2, 0] * a[0] + R[2, 1] * a[1] + R[2, 2] * a[2],
    )


@inner_kernel
def rotate_back(R: np.ndarray, a: Vector) -> Vector:
    """``R^T a``."""
    return (
        R[0, 0] * a[0] + R[1, 0] * a[1] + R[2, 0] * a[2],
        R[0, 1] * a[0] + R[1, 1] * a[1] + R[2, 1] * a[2],
        R[0, 2] * a[0] + R[1, 2] * a[1] + R[2, 2] * a[2],
    )
