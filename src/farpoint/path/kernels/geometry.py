"""Rotations, cross products and shutter effects of single points, inlined in their callers."""

from __future__ import annotations

from farpoint._kernels.compile import step_kernel

__all__ = ["cross", "lag", "rotated", "rotated_back"]


@step_kernel
def rotated(R, x, y, z):
    """``R @ [x, y, z]``."""
    return (
        R[0, 0] * x + R[0, 1] * y + R[0, 2] * z,
        R[1, 0] * x + R[1, 1] * y + R[1, 2] * z,
        R[2, 0] * x + R[2, 1] * y + R[2, 2] * z,
    )


@step_kernel
def rotated_back(R, x, y, z):
    """``R.T @ [x, y, z]``."""
    return (
        R[0, 0] * x + R[1, 0] * y + R[2, 0] * z,
        R[0, 1] * x + R[1, 1] * y + R[2, 1] * z,
        R[0, 2] * x + R[1, 2] * y + R[2, 2] * z,
    )


@step_kernel
def cross(ax, ay, az, bx, by, bz):
    """``a x b``."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@step_kernel
def lag(twist, x, y, z, s):
    """``w x d + s v``: change per second of a homogeneous point that moves with the camera.

    ``w`` and ``v`` are the angular and the linear velocity, ``twist = [w, v]``, ``d = (x, y, z)``
    is the vector ``X - s p`` from the camera to the point, and ``s`` is the inverse depth.
    """
    cx, cy, cz = cross(twist[0], twist[1], twist[2], x, y, z)
    return cx + s * twist[3], cy + s * twist[4], cz + s * twist[5]
