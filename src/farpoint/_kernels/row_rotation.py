"""Rolling shutter: rotation of rays from the time of their row to the time of the middle row."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.compile import inlined_kernel, kernel
from farpoint._kernels.vectors import Matrix, Vector, cross, dot, rotate, vector

__all__ = ["RowMotion", "column", "unroll_rays", "unrolled_ray"]


class RowMotion(NamedTuple):
    """Motion of a camera while the rows of an image are read. By default, the shutter is global.

    ``rate`` (3,) is the rotation vector of the camera from the first row to the last, and ``turn``
    (3,) is the rotation vector of the direction of translation. ``rate_by_readout`` and
    ``turn_by_readout`` (3,) are their derivatives by the error of the read-out time. ``per_px`` is
    the time from one row to the next, divided by the read-out time.
    """

    rate: np.ndarray = np.zeros(3)
    turn: np.ndarray = np.zeros(3)
    rate_by_readout: np.ndarray = np.zeros(3)
    turn_by_readout: np.ndarray = np.zeros(3)
    per_px: float = 0.0


@kernel
def unroll_rays(
    rays: np.ndarray,
    by_pixel: np.ndarray,
    phases: np.ndarray,
    means: np.ndarray,
    rows: RowMotion,
    unrolled: np.ndarray,
    unrolled_by_pixel: np.ndarray,
) -> None:
    """Rays (N, 3) ``Exp(-mean turn) Exp(-phase rate) ray``, and their derivatives by the pixel.

    A phase is the time of a row after the middle row, divided by the read-out time; a mean is the
    mean phase of the two rows of a match. A lower row is read later. The derivatives have the shape
    (N, 3, 2).
    """
    for i in range(len(rays)):
        ray, u, v, by_row = unrolled_ray(rays, by_pixel, i, phases[i], means[i], rows)
        unrolled[i, 0], unrolled[i, 1], unrolled[i, 2] = ray
        for k in range(3):
            unrolled_by_pixel[i, k, 0] = u[k]
            unrolled_by_pixel[i, k, 1] = v[k] + by_row[k]


@inlined_kernel
def unrolled_ray(
    rays: np.ndarray, by_pixel: np.ndarray, i: int, phase: float, mean: float, rows: RowMotion
) -> tuple[Vector, Vector, Vector, Vector]:
    """Ray ``i`` in the axes of the middle row, and its derivatives.

    The derivatives are those by both coordinates of the pixel, without and with the time of the
    row: ``d ray / du``, ``d ray / dv`` for the same time, and what the time of the row adds to the
    second.
    """
    C = rotation_about(vector(rows.rate), -phase)
    D = rotation_about(vector(rows.turn), -mean)
    ray, velocity = rotate(D, rotate(C, vector(rays[i]))), rotate(D, vector(rows.rate))
    x, y, z = cross(ray, velocity)
    by_row = rows.per_px * x, rows.per_px * y, rows.per_px * z
    u, v = rotate(C, column(by_pixel, i, 0)), rotate(C, column(by_pixel, i, 1))
    return ray, rotate(D, u), rotate(D, v), by_row


@inlined_kernel
def column(columns: np.ndarray, i: int, j: int) -> Vector:
    """Column j of matrix i of an array (N, 3, K)."""
    return columns[i, 0, j], columns[i, 1, j], columns[i, 2, j]


@inlined_kernel
def rotation_about(v: Vector, scale: float) -> Matrix:
    """Rotation matrix ``Exp(scale v)`` by Rodrigues's formula."""
    length = math.sqrt(dot(v, v))
    over = 1.0 / length if length > 0.0 else 0.0
    x, y, z = v[0] * over, v[1] * over, v[2] * over
    s, c = math.sin(scale * length), 1.0 - math.cos(scale * length)
    return (
        (1.0 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y),
        (c * x * y + s * z, 1.0 - c * (x * x + z * z), c * y * z - s * x),
        (c * x * z - s * y, c * y * z + s * x, 1.0 - c * (x * x + y * y)),
    )
