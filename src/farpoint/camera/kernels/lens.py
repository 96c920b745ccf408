"""Loops over rays for lens models: derivative of a ray by its pixel, and pinhole with distortion.

``k`` holds the first twelve coefficients of radial-tangential distortion in OpenCV's order: ``k1 k2
p1 p2 k3 k4 k5 k6 s1 s2 s3 s4``. Coefficients that a lens does not have are zero.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inlined_kernel, kernel, step_kernel
from farpoint._kernels.constants import MAX_ITERATIONS
from farpoint._kernels.scalars import where
from farpoint._kernels.vectors import Vector
from farpoint.camera.kernels.constants import LENS_TABLE_STEPS, LENS_TOLERANCE

__all__ = [
    "distort",
    "invert_projection",
    "pinhole_ray_jacobian",
    "pinhole_rays",
    "straight_ray_jacobian",
    "undistort",
]


@kernel
def pinhole_rays(
    pixels: np.ndarray, fx: float, fy: float, cx: float, cy: float, rays: np.ndarray
) -> None:
    """Unit rays (N, 3) of pixels (N, 2) of a pinhole; rows are NaN for pixels without a ray."""
    for i in range(len(pixels)):
        _pinhole_ray(pixels, i, fx, fy, cx, cy, rays)


@step_kernel
def _pinhole_ray(
    pixels: np.ndarray, i: int, fx: float, fy: float, cx: float, cy: float, rays: np.ndarray
) -> None:
    x, y = (pixels[i, 0] - cx) / fx, (pixels[i, 1] - cy) / fy
    square = x * x + y * y + 1.0
    scale = where(square < math.inf, 1.0 / math.sqrt(square), math.nan)
    rays[i, 0], rays[i, 1], rays[i, 2] = x * scale, y * scale, scale


@kernel
def invert_projection(rays: np.ndarray, forward: np.ndarray, jacobian: np.ndarray) -> None:
    """Derivative (N, 3, 2) of unit rays by pixels, from the derivative (N, 2, 3) of the projection.

    The rows ``u`` and ``v`` of the derivative of the projection, taken at a ray ``r`` of any
    length, are perpendicular to ``r``. The pseudo-inverse therefore has the columns ``v x r`` and
    ``r x u``, divided by ``r . (u x v)``. The derivative of the unit ray is the pseudo-inverse
    divided by ``|r|``.
    """
    for i in range(len(rays)):
        rx, ry, rz = rays[i, 0], rays[i, 1], rays[i, 2]
        ux, uy, uz = forward[i, 0, 0], forward[i, 0, 1], forward[i, 0, 2]
        vx, vy, vz = forward[i, 1, 0], forward[i, 1, 1], forward[i, 1, 2]
        volume = rx * (uy * vz - uz * vy) + ry * (uz * vx - ux * vz) + rz * (ux * vy - uy * vx)
        scaled = volume * np.sqrt(rx * rx + ry * ry + rz * rz)
        inverse = 1.0 / scaled if scaled != 0.0 else np.nan
        jacobian[i, 0, 0] = (vy * rz - vz * ry) * inverse
        jacobian[i, 1, 0] = (vz * rx - vx * rz) * inverse
        jacobian[i, 2, 0] = (vx * ry - vy * rx) * inverse
        jacobian[i, 0, 1] = (ry * uz - rz * uy) * inverse
        jacobian[i, 1, 1] = (rz * ux - rx * uz) * inverse
        jacobian[i, 2, 1] = (rx * uy - ry * ux) * inverse


@inlined_kernel
def _distort_point(
    k: np.ndarray, x: float, y: float
) -> tuple[float, float, float, float, float, float]:
    """Distorted point (a, b) and its derivatives, a_x, a_y, b_x, b_y."""
    p1, p2 = k[2], k[3]
    xx, yy, xy = x * x, y * y, x * y
    r2 = xx + yy
    loss = 1.0 + r2 * (k[5] + r2 * (k[6] + r2 * k[7]))
    loss_slope = k[5] + r2 * (2.0 * k[6] + r2 * (3.0 * k[7]))
    gain = (1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))) / loss
    slope = (k[0] + r2 * (2.0 * k[1] + r2 * (3.0 * k[4])) - gain * loss_slope) / loss
    a = x * gain + 2.0 * p1 * xy + p2 * (r2 + 2.0 * xx) + r2 * (k[8] + k[9] * r2)
    b = y * gain + p1 * (r2 + 2.0 * yy) + 2.0 * p2 * xy + r2 * (k[10] + k[11] * r2)
    prism_a, prism_b = 2.0 * (k[8] + 2.0 * k[9] * r2), 2.0 * (k[10] + 2.0 * k[11] * r2)
    skewed = 2.0 * (xy * slope + p1 * x + p2 * y)
    a_x = gain + 2.0 * xx * slope + 2.0 * p1 * y + 6.0 * p2 * x + x * prism_a
    b_y = gain + 2.0 * yy * slope + 6.0 * p1 * y + 2.0 * p2 * x + y * prism_b
    return a, b, a_x, skewed + y * prism_a, skewed + x * prism_b, b_y


@kernel
def distort(k: np.ndarray, x: np.ndarray, y: np.ndarray, out: np.ndarray) -> None:
    """Rows (6, N) of distorted points and their derivatives: a, b, a_x, a_y, b_x, b_y."""
    for i in range(len(x)):
        out[0, i], out[1, i], out[2, i], out[3, i], out[4, i], out[5, i] = _distort_point(
            k, x[i], y[i]
        )


@inlined_kernel
def _interpolate(target: float, arguments: np.ndarray, values: np.ndarray) -> float:
    """Piecewise linear function from a table; constant above the largest argument of the table."""
    low, high = 0, len(arguments) - 1
    if target >= arguments[high]:
        return values[high]
    while high - low > 1:
        middle = (low + high) // 2
        if arguments[middle] <= target:
            low = middle
        else:
            high = middle
    share = (target - arguments[low]) / (arguments[high] - arguments[low])
    return values[low] + share * (values[high] - values[low])


@inlined_kernel
def _scale(radius: float, table: tuple[np.ndarray, np.ndarray, np.ndarray]) -> float:
    """Approximate ratio of undistorted to distorted radius, for the radial distortion only."""
    place = radius / (1.0 + radius) * LENS_TABLE_STEPS
    if place >= len(table[2]) - 1:
        return _interpolate(radius, table[0], table[1]) / radius
    low = int(place)
    return table[2][low] + (place - low) * (table[2][low + 1] - table[2][low])


@inlined_kernel
def _newton_pass(
    k: np.ndarray, a: np.ndarray, b: np.ndarray, x: np.ndarray, y: np.ndarray, steps: np.ndarray
) -> int:
    """One step of Newton's method for each point whose last step was long.

    ``steps`` (N,) is the length of each point's last step over the tolerance. Steps above 1 are
    long; NaN counts as short. The function returns the number of points whose step is still long.
    The loop has no branches, so that the compiler can use vector instructions.
    """
    unconverged = 0
    for i in range(len(a)):
        at_a, at_b, a_x, a_y, b_x, b_y = _distort_point(k, x[i], y[i])
        inverse = 1.0 / (a_x * b_y - a_y * b_x)
        step_x = (b_y * (a[i] - at_a) - a_y * (b[i] - at_b)) * inverse
        step_y = (a_x * (b[i] - at_b) - b_x * (a[i] - at_a)) * inverse
        moved_x, moved_y = x[i] + step_x, y[i] + step_y
        limit = LENS_TOLERANCE * (1.0 + abs(moved_x) + abs(moved_y))
        was_long = steps[i] > 1.0
        x[i], y[i] = where(was_long, moved_x, x[i]), where(was_long, moved_y, y[i])
        steps[i] = where(was_long, (abs(step_x) + abs(step_y)) / limit, steps[i])
        unconverged += 1 if steps[i] > 1.0 else 0
    return unconverged


@kernel
def undistort(
    k: np.ndarray,
    a: np.ndarray,
    b: np.ndarray,
    table: tuple[np.ndarray, np.ndarray, np.ndarray],
    farthest: float,
    fold: float,
    out: np.ndarray,
) -> None:
    """Inverse of `distort`: rows x and y (2, N); NaN for points outside the image of the lens.

    ``table`` holds distorted radii r, the undistorted radius of each, and the ratio of undistorted
    to distorted radius in even steps of ``r / (1 + r)``. Newton's method starts at the distorted
    point times this ratio. ``farthest`` is the largest distorted radius inside the image of the
    lens, and ``fold`` the largest undistorted radius.
    """
    x, y = out[0], out[1]
    for i in range(len(a)):
        radius = math.sqrt(a[i] * a[i] + b[i] * b[i])
        # Beyond the farthest radius there is no solution for Newton's method.
        is_reached = radius <= farthest and radius < math.inf
        scale = _scale(radius, table) if is_reached else math.nan
        x[i], y[i] = a[i] * scale, b[i] * scale
    steps, passes = np.full(len(a), math.inf), 0
    while passes < MAX_ITERATIONS and _newton_pass(k, a, b, x, y, steps) > 0:
        passes += 1
    for i in range(len(a)):
        if steps[i] > 1.0 or not x[i] * x[i] + y[i] * y[i] < fold * fold:
            x[i] = y[i] = np.nan


@kernel
def pinhole_ray_jacobian(
    k: np.ndarray, fold: float, fx: float, fy: float, rays: np.ndarray, jacobian: np.ndarray
) -> None:
    """Derivative (N, 3, 2) of unit rays by the pixels of a distorted pinhole; NaN beyond `fold`.

    `fold` is the largest undistorted radius. The rays may have any length. With ``v = (x, y, 1)``
    and the unit ray ``r = v / |v|``, the derivative is ``dr = (dv - r (r . dv)) / |v|``.
    """
    for i in range(len(rays)):
        _pinhole_ray_jacobian(k, fold, fx, fy, rays, i, jacobian)


@step_kernel
def _pinhole_ray_jacobian(
    k: np.ndarray,
    fold: float,
    fx: float,
    fy: float,
    rays: np.ndarray,
    i: int,
    jacobian: np.ndarray,
) -> None:
    x, y, z = rays[i, 0], rays[i, 1], rays[i, 2]
    over = 1.0 / math.sqrt(x * x + y * y + z * z)
    rx, ry, rz = x * over, y * over, z * over
    inverse = 1.0 / z
    x, y = x * inverse, y * inverse
    _, _, a_x, a_y, b_x, b_y = _distort_point(k, x, y)
    visible = (rz > 0.0) & (x * x + y * y < fold * fold)
    scale = where(visible, rz / (a_x * b_y - a_y * b_x), math.nan)
    over_x, over_y = scale * (1.0 / fx), scale * (1.0 / fy)
    by_x, by_y = (b_y * over_x, -b_x * over_x), (-a_y * over_y, a_x * over_y)
    _write_tangents((rx, ry, rz), (by_x, by_y), jacobian, i)


@kernel
def straight_ray_jacobian(fx: float, fy: float, rays: np.ndarray, jacobian: np.ndarray) -> None:
    """Derivative (N, 3, 2) as in `pinhole_ray_jacobian`, for a pinhole without distortion."""
    for i in range(len(rays)):
        _straight_ray_jacobian(fx, fy, rays, i, jacobian)


@step_kernel
def _straight_ray_jacobian(
    fx: float, fy: float, rays: np.ndarray, i: int, jacobian: np.ndarray
) -> None:
    x, y, z = rays[i, 0], rays[i, 1], rays[i, 2]
    over = 1.0 / math.sqrt(x * x + y * y + z * z)
    scale = where(z > 0.0, z * over, math.nan)
    by_x, by_y = (scale * (1.0 / fx), 0.0), (0.0, scale * (1.0 / fy))
    _write_tangents((x * over, y * over, z * over), (by_x, by_y), jacobian, i)


@inlined_kernel
def _write_tangents(
    ray: Vector,
    steps: tuple[tuple[float, float], tuple[float, float]],
    jacobian: np.ndarray,
    i: int,
) -> None:
    """Write ``jacobian[i]``: column j is the part of step j that is perpendicular to the unit ray.

    A step (x, y), with z = 0, is ``dv / |v|``: the derivative of ``v = (x, y, 1)`` by a pixel
    coordinate, divided by ``|v|``.
    """
    for column in range(2):
        x, y = steps[column]
        along = ray[0] * x + ray[1] * y
        jacobian[i, 0, column] = x - ray[0] * along
        jacobian[i, 1, column] = y - ray[1] * along
        jacobian[i, 2, column] = -ray[2] * along
