"""Grey values of surfaces over the footprint of a pixel.

Points, directions and steps are tuples (x, y, z). A step is the change of the ray's direction to
the next pixel on the right, or to the next pixel below. Each of the two steps shifts the
intersection of the ray with the surface. The two shifts define an ellipse on the surface, the
footprint of the pixel.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.compile import inlined_kernel, step_kernel
from farpoint._kernels.vectors import Vector
from farpoint.synthetic.kernels.constants import (
    BOX,
    CLOUD_GAIN,
    CLOUD_TEXEL,
    COARSE_TEXEL_M,
    ELLIPSOID,
    FACE_SHIFT_M,
    FINE_TEXEL_M,
    FIRST_RING,
    GROUND,
    MIN_INCIDENCE_COSINE,
    NOISE_TEXTURE,
    SKY,
    TOP_FACE,
)
from farpoint.synthetic.kernels.raycast import Hit, Ray
from farpoint.synthetic.kernels.scene_arrays import Blocks, Finish, Hills
from farpoint.synthetic.kernels.texture import Footprint, filtered, footprint_of, scaled

__all__ = ["RayDifferential", "ray_grey"]


class RayDifferential(NamedTuple):
    """Ray differential: change of a ray's direction to the next pixel."""

    right: Vector
    down: Vector


class Frame(NamedTuple):
    """Local frame of a surface at the intersection."""

    normal: Vector
    """Normal of either sign, not normalised."""
    along_u: Vector
    """Unit vector along the texture's u."""
    along_v: Vector
    """Unit vector along the texture's v."""
    u: float
    """Texture coordinate, m."""
    v: float
    """Texture coordinate, m."""


@step_kernel
def box_frame(shape: np.ndarray, index: int, face: int, point: Vector) -> Frame:
    """Local frame of the face of a box, at a point relative to the axis of the box."""
    x, y, z = point
    cos, sin = shape[index, 2], shape[index, 3]
    along_x, along_z = (cos, 0.0, sin), (-sin, 0.0, cos)
    px, pz = x * cos + z * sin, z * cos - x * sin
    if face >= TOP_FACE:
        return Frame((0.0, 1.0, 0.0), along_x, along_z, px, pz)
    if face < 2:
        return Frame(along_x, along_z, (0.0, 1.0, 0.0), pz, y)
    return Frame(along_z, along_x, (0.0, 1.0, 0.0), px, y)


@inlined_kernel
def round_frame(radius: float, slope: float, point: Vector, v: float) -> Frame:
    """Local frame of a round surface, at a point relative to its centre.

    The texture is wrapped around the surface. ``slope`` is ``(radius / half_height)^2`` for an
    ellipsoid, and 0 for a cylinder or a ring of hills.
    """
    x, y, z = point
    across = math.sqrt(x * x + z * z) + 1e-12
    normal = (x / across, slope * y / across, z / across)
    # Mirrored halfway around, so that the texture closes without a seam.
    angle = math.atan2(x - z, x + z)
    sense = math.copysign(1.0, angle)
    around = (sense * z / across, 0.0, -sense * x / across)
    return Frame(normal, around, (0.0, 1.0, 0.0), radius * abs(angle), v)


@step_kernel
def surface_frame(blocks: Blocks, hills: Hills, hit: Hit, point: Vector) -> Frame:
    """Local frame of the surface at the intersection."""
    shape, ring, surface = blocks.shape, hills.ring, hit.surface
    x, y, z = point
    if surface == GROUND:
        return Frame((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), x, z)
    if surface <= FIRST_RING:
        k = FIRST_RING - surface
        return round_frame(ring[k, 2], 0.0, (x - ring[k, 0], y, z - ring[k, 1]), y)
    x, z = x - shape[surface, 0], z - shape[surface, 1]
    if shape[surface, 8] == BOX:
        return box_frame(shape, surface, hit.face, (x, y, z))
    radius, slope = shape[surface, 4], 0.0
    if shape[surface, 8] == ELLIPSOID:
        slope = (2.0 * radius / (shape[surface, 7] - shape[surface, 6])) ** 2
    centred = y - 0.5 * (shape[surface, 6] + shape[surface, 7])
    return round_frame(radius, slope, (x, centred, z), y)


@inlined_kernel
def dot(a: Vector, b: Vector) -> float:
    """Inner product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@step_kernel
def light(normal: Vector) -> float:
    """Brightness factor of a surface with this normal, so that two walls of a house differ."""
    lit = abs(0.35 * normal[0] - 0.75 * normal[1] + 0.55 * normal[2])
    return 0.72 + 0.28 * lit / math.sqrt(dot(normal, normal))


@step_kernel
def sky_footprint(direction: Vector, differential: RayDifferential) -> Footprint:
    """Footprint of a pixel on the clouds, which are infinitely far away.

    The layer of clouds curves down towards the horizon.
    """
    (right_x, right_y, right_z), (down_x, down_y, down_z) = differential.right, differential.down
    depth = 0.35 - direction[1]
    u, v = direction[0] / depth, direction[2] / depth
    ux, vx = (right_x + u * right_y) / depth, (right_z + v * right_y) / depth
    uy, vy = (down_x + u * down_y) / depth, (down_z + v * down_y) / depth
    return footprint_of(u, v, (ux, vx), (uy, vy))


@step_kernel
def wall_footprint(
    frame: Frame, t: float, direction: Vector, differential: RayDifferential
) -> Footprint:
    """Footprint of a pixel on a surface, m."""
    normal, along_u, along_v = frame.normal, frame.along_u, frame.along_v
    facing = dot(normal, direction)
    facing = math.copysign(max(abs(facing), MIN_INCIDENCE_COSINE), facing)
    # A step moves the intersection by t (step - direction (normal . step / facing)).
    slide_x, slide_y = (
        dot(normal, differential.right) / facing,
        dot(normal, differential.down) / facing,
    )
    du, dv = dot(along_u, direction), dot(along_v, direction)
    ux = t * (dot(along_u, differential.right) - slide_x * du)
    uy = t * (dot(along_u, differential.down) - slide_y * du)
    vx = t * (dot(along_v, differential.right) - slide_x * dv)
    vy = t * (dot(along_v, differential.down) - slide_y * dv)
    return footprint_of(frame.u, frame.v, (ux, vx), (uy, vy))


@step_kernel
def sky_grey(finish: Finish, direction: Vector, differential: RayDifferential) -> float:
    """Grey value of the sky: a gradient by elevation, and the noise texture as clouds."""
    footprint = sky_footprint(direction, differential)
    clouds = filtered(
        finish, NOISE_TEXTURE, scaled(footprint, footprint.u, footprint.v, 1.0 / CLOUD_TEXEL)
    )
    return 205.0 + 25.0 * (direction[1] + 0.3) + CLOUD_GAIN * clouds


@step_kernel
def paint_row(blocks: Blocks, surface: int) -> int:
    """Row of a surface in the table of paints."""
    if surface >= 0:
        return surface
    row = blocks.shape.shape[0]
    return row + 1 + FIRST_RING - surface if surface <= FIRST_RING else row


@step_kernel
def ray_grey(
    blocks: Blocks, hills: Hills, finish: Finish, ray: Ray, differential: RayDifferential, hit: Hit
) -> float:
    """Grey value at the end of a ray, averaged over the footprint of the pixel."""
    if hit.surface == SKY:
        return sky_grey(finish, ray.direction, differential)
    (ox, oy, oz), (dx, dy, dz), t = ray.origin, ray.direction, hit.distance
    frame = surface_frame(blocks, hills, hit, (ox + t * dx, oy + t * dy, oz + t * dz))
    footprint = wall_footprint(frame, t, ray.direction, differential)
    paint, row = finish.paint, paint_row(blocks, hit.surface)
    pattern, pattern_m, pattern_gain = int(paint[row, 1]), paint[row, 2], paint[row, 3]
    u, v, noise_gain = footprint.u + paint[row, 5], footprint.v + paint[row, 6], paint[row, 4]
    grey = paint[row, 0] * (light(frame.normal) if hit.surface >= 0 else 1.0)
    # Layers: the pattern, fine noise, coarse noise.
    first = 1 if pattern_gain == 0.0 or hit.face >= TOP_FACE else 0
    for layer in range(first, 3):
        index, gain, scale, shift = (
            NOISE_TEXTURE,
            noise_gain,
            1.0 / COARSE_TEXEL_M,
            FACE_SHIFT_M * hit.face,
        )
        if layer == 0:
            index, gain, scale, shift = pattern, pattern_gain, 1.0 / pattern_m, 0.0
        elif layer == 1:
            scale = 1.0 / FINE_TEXEL_M
        grey += gain * filtered(finish, index, scaled(footprint, u + shift, v - shift, scale))
    return grey
