"""Rolling shutter: rotation of rays from the time of their row to the time of the middle row."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inlined_kernel, kernel
from farpoint._kernels.vectors import Matrix, Vector, cross, dot, rotate, vector

__all__ = ["axis_and_angle", "column", "rotation_about", "unroll_rays"]


@kernel
def unroll_rays(
    rays: np.ndarray,
    by_pixel: np.ndarray,
    phases: np.ndarray,
    rate: np.ndarray,
    per_px: float,
    unrolled: np.ndarray,
    unrolled_by_pixel: np.ndarray,
) -> None:
    """Rays (N, 3) ``Exp(-phase rate) ray``, and the derivatives (N, 3, 2) of the rays by the pixel.

    A phase is the time of a row after the middle row, divided by the read-out time. ``per_px`` is
    the change of the phase from one row to the next lower row, which is read later. ``rate`` is the
    rotation vector of the camera from the first row to the last.
    """
    velocity = vector(rate)
    axis, angle = axis_and_angle(velocity)
    for i in range(len(rays)):
        C = rotation_about(axis, -angle * phases[i])
        ray = rotate(C, vector(rays[i]))
        unrolled[i, 0], unrolled[i, 1], unrolled[i, 2] = ray
        later = cross(velocity, ray)
        for k in range(3):
            unrolled_by_pixel[i, k, 0] = dot(C[k], column(by_pixel, i, 0))
            unrolled_by_pixel[i, k, 1] = dot(C[k], column(by_pixel, i, 1)) - per_px * later[k]


@inlined_kernel
def column(columns: np.ndarray, i: int, j: int) -> Vector:
    """Column j of matrix i of an array (N, 3, K)."""
    return columns[i, 0, j], columns[i, 1, j], columns[i, 2, j]


@inlined_kernel
def axis_and_angle(v: Vector) -> tuple[Vector, float]:
    """Unit vector along a rotation vector (or zero), and the length of the rotation vector, rad."""
    angle = math.sqrt(dot(v, v))
    over = 1.0 / angle if angle > 0.0 else 0.0
    return (v[0] * over, v[1] * over, v[2] * over), angle


@inlined_kernel
def rotation_about(axis: Vector, angle: float) -> Matrix:
    """Rotation matrix by Rodrigues's formula."""
    x, y, z = axis
    s, c = math.sin(angle), 1.0 - math.cos(angle)
    return (
        (1.0 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y),
        (c * x * y + s * z, 1.0 - c * (x * x + z * z), c * y * z - s * x),
        (c * x * z - s * y, c * y * z + s * x, 1.0 - c * (x * x + y * y)),
    )
