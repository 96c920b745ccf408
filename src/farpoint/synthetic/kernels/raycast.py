"""Ray casting: traversal of the cells of a grid of shapes, then intersection with the hills.

Directions need not have unit length. Distances are in units of the length of the direction. The
traversal is that of Amanatides and Woo, "A Fast Voxel Traversal Algorithm for Ray Tracing",
Eurographics 1987.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.compile import inlined_kernel, kernel, step_kernel
from farpoint._kernels.vectors import Vector
from farpoint.synthetic.kernels.constants import (
    BOX,
    ELLIPSOID,
    FIRST_RING,
    GROUND,
    NOTHING,
    SKY,
    TOP_FACE,
)
from farpoint.synthetic.kernels.scene_arrays import Blocks, Hills

__all__ = ["Hit", "Ray", "cast_rays", "trace"]


class Ray(NamedTuple):
    """Origin, m, and direction of a ray."""

    origin: Vector
    direction: Vector


class Hit(NamedTuple):
    """First intersection of a ray."""

    distance: float
    """Distance, in units of the length of the direction."""
    surface: int
    """Number of a shape, or GROUND, SKY, or FIRST_RING and downwards for a ring of hills."""
    face: int
    """Face of a box: 0 to 3 for the sides -x, +x, -z, +z, 4 for the top, 5 for the bottom."""


@inlined_kernel
def slab(origin: float, direction: float, half: float) -> tuple[float, float]:
    """Distances at which one coordinate of a ray enters and leaves ``[-half, half]``."""
    if direction == 0.0:
        return (-math.inf, math.inf) if abs(origin) <= half else (math.inf, -math.inf)
    centre, reach = -origin / direction, abs(half / direction)
    return centre - reach, centre + reach


@step_kernel
def hit_box(ray: Ray, half: Vector) -> tuple[float, int]:
    """Distance to a box, and face of the box; the distance is infinite if the ray misses the box.

    The ray is given in the axes of the box, relative to the centre of the box.
    """
    (px, py, pz), (dx, dy, dz), (half_x, half_y, half_z) = ray.origin, ray.direction, half
    near_x, far_x = slab(px, dx, half_x)
    near_y, far_y = slab(py, dy, half_y)
    near_z, far_z = slab(pz, dz, half_z)
    enter = max(near_x, near_y, near_z)
    if not 0.0 < enter <= min(far_x, far_y, far_z):
        return math.inf, 0
    if enter == near_x:
        return enter, 0 if dx > 0.0 else 1
    if enter == near_z:
        return enter, 2 if dz > 0.0 else 3
    return enter, TOP_FACE if dy > 0.0 else TOP_FACE + 1


@step_kernel
def hit_round(ray: Ray, radius: float, half_height: float, stretch: float) -> float:
    """Distance to an ellipsoid, or to the side of an upright cylinder.

    ``stretch`` is the factor on y that makes the ellipsoid a sphere; 0 for a cylinder.
    """
    (px, py, pz), (dx, dy, dz) = ray.origin, ray.direction
    qy, sy = py * stretch, dy * stretch
    a = dx * dx + sy * sy + dz * dz
    half_b = px * dx + qy * sy + pz * dz
    square = half_b * half_b - a * (px * px + qy * qy + pz * pz - radius * radius)
    if square < 0.0 or a == 0.0:
        return math.inf
    t = (-half_b - math.sqrt(square)) / a
    # An ellipsoid lies within its height up to rounding.
    return t if t > 0.0 and abs(py + t * dy) <= half_height * 1.000001 else math.inf


@step_kernel
def hit_shape(shape: np.ndarray, index: int, ray: Ray) -> tuple[float, int]:
    """Distance to a shape, and face of the shape."""
    (ox, oy, oz), (dx, dy, dz) = ray.origin, ray.direction
    x, z = ox - shape[index, 0], oz - shape[index, 1]
    y = oy - 0.5 * (shape[index, 6] + shape[index, 7])
    half_height = 0.5 * (shape[index, 7] - shape[index, 6])
    half_x, half_z = shape[index, 4], shape[index, 5]
    if shape[index, 8] == BOX:
        cos, sin = shape[index, 2], shape[index, 3]
        origin = x * cos + z * sin, y, z * cos - x * sin
        direction = dx * cos + dz * sin, dy, dz * cos - dx * sin
        return hit_box(Ray(origin, direction), (half_x, half_height, half_z))
    stretch = half_x / half_height if shape[index, 8] == ELLIPSOID else 0.0
    return hit_round(Ray((x, y, z), ray.direction), half_x, half_height, stretch), 0


@step_kernel
def hit_hills(hills: Hills, ray: Ray) -> tuple[float, int]:
    """Distance to the nearest ring of hills, and the ring. The origin lies inside all rings."""
    ring, height = hills.ring, hills.height
    (ox, oy, oz), (dx, dy, dz) = ray.origin, ray.direction
    a = dx * dx + dz * dz
    steps = height.shape[1]
    for k in range(ring.shape[0]):
        px, pz, radius = ox - ring[k, 0], oz - ring[k, 1], ring[k, 2]
        half_b = px * dx + pz * dz
        square = half_b * half_b - a * (px * px + pz * pz - radius * radius)
        if a < 1e-12 or square < 0.0:
            continue
        t = (-half_b + math.sqrt(square)) / a
        place = (math.atan2(px + t * dx, pz + t * dz) / (2.0 * math.pi) + 0.5) * steps
        step = int(place)
        left, right = height[k, step % steps], height[k, (step + 1) % steps]
        if -(oy + t * dy) < left + (place - step) * (right - left):
            return t, k
    return math.inf, -1


@inlined_kernel
def first_wall(
    origin: float, direction: float, corner: float, size: float
) -> tuple[int, int, float, float]:
    """Along one axis: the cell of the origin, the step to the next cell, and two distances.

    The first distance is from the origin to the first cell wall, the second from wall to wall.
    """
    cell = math.floor((origin - corner) / size)
    if direction == 0.0:
        return cell, 0, math.inf, math.inf
    step = 1 if direction > 0.0 else -1
    wall = corner + size * (cell + (1 if step > 0 else 0))
    return cell, step, (wall - origin) / direction, size / abs(direction)


@step_kernel
def hit_shapes(blocks: Blocks, ray: Ray, limit: float) -> tuple[float, int, int]:
    """Nearest shape closer than ``limit``: distance, shape (NOTHING if there is none) and face."""
    shape, cell_shape, grid = blocks.shape, blocks.cell_shape, blocks.grid
    (ox, oy, oz), (dx, dy, dz) = ray.origin, ray.direction
    nx, nz = int(grid[3]), int(grid[4])
    i, step_i, wall_i, between_i = first_wall(ox, dx, grid[0], grid[2])
    j, step_j, wall_j, between_j = first_wall(oz, dz, grid[1], grid[2])
    best, found, face, entered = limit, NOTHING, 0, 0.0
    while 0 <= i < nx and 0 <= j < nz and entered < best:
        cell, leaves = j * nx + i, min(wall_i, wall_j)
        lowest = oy + dy * (min(leaves, best) if dy > 0.0 else entered)
        if lowest >= blocks.cell_top[cell]:
            for k in range(blocks.cell_start[cell], blocks.cell_start[cell + 1]):
                t, at = hit_shape(shape, cell_shape[k], ray)
                if t < best:
                    best, found, face = t, cell_shape[k], at
        if wall_i < wall_j:
            i, wall_i = i + step_i, wall_i + between_i
        else:
            j, wall_j = j + step_j, wall_j + between_j
        entered = leaves
    return best, found, face


@inlined_kernel
def trace(blocks: Blocks, hills: Hills, ray: Ray) -> Hit:
    """First intersection of a ray."""
    down, below = ray.direction[1], ray.origin[1]
    reach = math.inf
    if down > 0.0:
        reach = -below / down  # the ground
    elif down < 0.0:
        reach = max(0.0, (blocks.grid[5] - below) / down)  # beyond, the ray is above all shapes
    t, surface, face = hit_shapes(blocks, ray, reach)
    if surface != NOTHING:
        return Hit(t, surface, face)
    t, k = hit_hills(hills, ray)
    if down > 0.0 and reach <= t:
        return Hit(reach, GROUND, 0)
    if k >= 0:
        return Hit(t, FIRST_RING - k, 0)
    return Hit(math.inf, SKY, 0)


@kernel
def cast_rays(
    blocks: Blocks,
    hills: Hills,
    origins: np.ndarray,
    directions: np.ndarray,
    distances: np.ndarray,
) -> None:
    """Fill ``distances`` (N,) to the first surface from ``origins`` along ``directions`` (N, 3).

    The unit of each distance is the length of the direction. A distance is infinite for the sky,
    and NaN if the direction is NaN.
    """
    for i in range(len(directions)):
        start = origins[i, 0], origins[i, 1], origins[i, 2]
        direction = directions[i, 0], directions[i, 1], directions[i, 2]
        distances[i] = math.nan
        if not math.isnan(direction[0] + direction[1] + direction[2]):
            distances[i] = trace(blocks, hills, Ray(start, direction)).distance
