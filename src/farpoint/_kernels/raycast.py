"""What a ray hits first: a walk through the cells of the scene's grid, then the hills.

Directions need not have unit length: distances are counted in lengths of the direction. The grid is
walked by Amanatides and Woo, "A Fast Voxel Traversal Algorithm for Ray Tracing", Eurographics 1987.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import kernel
from farpoint._kernels.scene_arrays import BOX, CYLINDER, GROUND, NOTHING, SKY, SceneArrays

__all__ = ["cast_rays", "trace"]

TOP_FACE = 4


@kernel
def hit_box(shape, ox, oy, oz, dx, dy, dz):
    """Distance and face (0-3 the sides -x, +x, -z, +z; 4 top, 5 bottom); infinity for a miss."""
    cos, sin = shape[2], shape[3]
    px = (ox - shape[0]) * cos + (oz - shape[1]) * sin
    pz = (oz - shape[1]) * cos - (ox - shape[0]) * sin
    qx = dx * cos + dz * sin
    qz = dz * cos - dx * sin
    near_x, far_x = slab(px, qx, -shape[4], shape[4])
    near_z, far_z = slab(pz, qz, -shape[5], shape[5])
    near_y, far_y = slab(oy, dy, shape[6], shape[7])
    enter, face = near_x, 0 if qx > 0.0 else 1
    if near_z > enter:
        enter, face = near_z, 2 if qz > 0.0 else 3
    if near_y > enter:
        enter, face = near_y, 4 if dy > 0.0 else 5
    if enter > 0.0 and enter <= min(far_x, far_y, far_z):
        return enter, face
    return math.inf, 0


@kernel
def slab(origin, direction, low, high):
    """Distances at which a coordinate enters and leaves ``[low, high]``."""
    if direction == 0.0:
        inside = low <= origin <= high
        return (-math.inf, math.inf) if inside else (math.inf, -math.inf)
    a, b = (low - origin) / direction, (high - origin) / direction
    return min(a, b), max(a, b)


@kernel
def hit_cylinder(shape, ox, oy, oz, dx, dy, dz):
    """Distance to the outer wall of an upright cylinder without lids."""
    px, pz, radius = ox - shape[0], oz - shape[1], shape[4]
    t = first_root(dx * dx + dz * dz, px * dx + pz * dz, px * px + pz * pz - radius * radius)
    y = oy + t * dy
    return t if shape[6] <= y <= shape[7] else math.inf


@kernel
def hit_ellipsoid(shape, ox, oy, oz, dx, dy, dz):
    """Distance to an ellipsoid with a round cross-section."""
    px, pz, radius = ox - shape[0], oz - shape[1], shape[4]
    stretch = 2.0 * radius / (shape[7] - shape[6])
    py, qy = (oy - 0.5 * (shape[6] + shape[7])) * stretch, dy * stretch
    return first_root(
        dx * dx + qy * qy + dz * dz,
        px * dx + py * qy + pz * dz,
        px * px + py * py + pz * pz - radius * radius,
    )


@kernel
def first_root(a, half_b, c):
    """Smaller root of ``a t^2 + 2 half_b t + c``; infinity unless it is positive."""
    square = half_b * half_b - a * c
    if square < 0.0 or a == 0.0:
        return math.inf
    t = (-half_b - math.sqrt(square)) / a
    return t if t > 0.0 else math.inf


@kernel
def hit_shape(scene, index, ox, oy, oz, dx, dy, dz):
    """Distance to a shape and its face."""
    shape, kind = scene.shape[index], scene.kind[index]
    if kind == BOX:
        return hit_box(shape, ox, oy, oz, dx, dy, dz)
    if kind == CYLINDER:
        return hit_cylinder(shape, ox, oy, oz, dx, dy, dz), 0
    return hit_ellipsoid(shape, ox, oy, oz, dx, dy, dz), 0


@kernel
def hit_hills(scene, ox, oy, oz, dx, dy, dz):
    """Distance to the nearest ring of hills, and the ring; the origin lies within all of them."""
    a = dx * dx + dz * dz
    steps = scene.ring_height.shape[1]
    for k in range(scene.ring.shape[0]):
        px, pz, radius = ox - scene.ring[k, 0], oz - scene.ring[k, 1], scene.ring[k, 2]
        half_b = px * dx + pz * dz
        square = half_b * half_b - a * (px * px + pz * pz - radius * radius)
        if a < 1e-12 or square < 0.0:
            continue
        t = (-half_b + math.sqrt(square)) / a
        place = (math.atan2(px + t * dx, pz + t * dz) / (2.0 * math.pi) + 0.5) * steps
        step = int(place)
        left, right = scene.ring_height[k, step % steps], scene.ring_height[k, (step + 1) % steps]
        if -(oy + t * dy) < left + (place - step) * (right - left):
            return t, k
    return math.inf, -1


@kernel
def cell_walk(origin, direction, corner, size):
    """First cell along one axis, step to the next, distance to the next wall, and between walls."""
    cell = math.floor((origin - corner) / size)
    if direction == 0.0:
        return cell, 0, math.inf, math.inf
    step = 1 if direction > 0.0 else -1
    wall = corner + size * (cell + (1 if step > 0 else 0))
    return cell, step, (wall - origin) / direction, size / abs(direction)


@kernel
def hit_shapes(scene, ox, oy, oz, dx, dy, dz, limit):
    """Nearest shape closer than ``limit``: distance, shape (NOTHING if none) and face."""
    nx, nz = int(scene.grid[3]), int(scene.grid[4])
    i, step_i, wall_i, between_i = cell_walk(ox, dx, scene.grid[0], scene.grid[2])
    j, step_j, wall_j, between_j = cell_walk(oz, dz, scene.grid[1], scene.grid[2])
    best, shape, face = limit, NOTHING, 0
    while 0 <= i < nx and 0 <= j < nz:
        cell = j * nx + i
        for k in range(scene.cell_start[cell], scene.cell_start[cell + 1]):
            index = scene.cell_shape[k]
            t, at = hit_shape(scene, index, ox, oy, oz, dx, dy, dz)
            if t < best:
                best, shape, face = t, index, at
        if best <= min(wall_i, wall_j):
            break
        if wall_i < wall_j:
            i, wall_i = i + step_i, wall_i + between_i
        else:
            if wall_j == math.inf:
                break
            j, wall_j = j + step_j, wall_j + between_j
    return best, shape, face


@kernel
def trace(scene, ox, oy, oz, dx, dy, dz):
    """Distance along a ray, the surface it hits first, and the face of that surface."""
    limit, surface, face = math.inf, SKY, 0
    reach = math.inf
    if dy > 0.0:
        limit, surface = -oy / dy, GROUND
        reach = limit
    elif dy < 0.0:
        reach = max(0.0, (scene.top_y - oy) / dy)  # above all shapes from there on
    t, shape, at = hit_shapes(scene, ox, oy, oz, dx, dy, dz, reach)
    if shape != NOTHING:
        return t, shape, at
    t, ring = hit_hills(scene, ox, oy, oz, dx, dy, dz)
    if ring >= 0 and t < limit:
        return t, -4 - ring, 0
    return limit, surface, face


@kernel
def cast_rays(
    scene: SceneArrays, origin: np.ndarray, directions: np.ndarray, distances: np.ndarray
) -> None:
    """Fill ``distances`` (N,), in lengths of ``directions`` (N, 3), from one origin; inf for sky."""
    for i in range(len(directions)):
        dx, dy, dz = directions[i]
        if math.isnan(dx + dy + dz):
            distances[i] = math.nan
            continue
        distances[i] = trace(scene, origin[0], origin[1], origin[2], dx, dy, dz)[0]
