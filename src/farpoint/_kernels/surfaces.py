"""Grey values of surfaces over the footprint of a pixel.

Points, directions and steps are tuples (x, y, z). A step is the change of the ray's direction by
one pixel, to the right or down; what it does to the point hit is the footprint.
"""

from __future__ import annotations

import math

from farpoint._kernels.compile import inlined_kernel
from farpoint._kernels.raycast import TOP_FACE
from farpoint._kernels.scene_arrays import BOX, ELLIPSOID, FIRST_RING, GROUND, SKY
from farpoint._kernels.texture import filtered, footprint_axes

__all__ = ["ray_grey"]

NOISE = 0  # texture of the noise that lies over every surface, at two scales
FINE_M = 0.011  # metres per texel
COARSE_M = 0.23
FACE_SHIFT_M = 7.3  # every face has its own part of the noise
_LEAST_COSINE = 0.02  # of the angle of incidence: footprints stay finite at silhouettes


@inlined_kernel
def box_frame(shape, index, face, x, z):
    """Normal, unit vectors of texture u and v, and the place along the shape's own x and z."""
    cos, sin = shape[index, 2], shape[index, 3]
    along_x, along_z = (cos, 0.0, sin), (-sin, 0.0, cos)
    px, pz = x * cos + z * sin, z * cos - x * sin
    if face >= TOP_FACE:
        return (0.0, 1.0, 0.0), along_x, along_z, px, pz
    if face < 2:
        return along_x, along_z, (0.0, 1.0, 0.0), pz, 0.0
    return along_z, along_x, (0.0, 1.0, 0.0), px, 0.0


@inlined_kernel
def round_frame(radius, slope, x, y, z):
    """Normal, unit vector around the axis, and the length along it."""
    across = math.sqrt(x * x + z * z) + 1e-12
    normal = (x / across, slope * y / across, z / across)
    # Mirrored halfway around, so that the texture closes without a seam.
    angle = math.atan2(x - z, x + z)
    sense = math.copysign(1.0, angle)
    around = (sense * z / across, 0.0, -sense * x / across)
    return normal, around, radius * abs(angle)


@inlined_kernel
def surface_frame(shape, ring, surface, face, x, y, z):
    """Normal (either sign), unit vectors along texture u and v, and u, v of a point, in metres."""
    down = (0.0, 1.0, 0.0)
    if surface == GROUND:
        return down, (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), x, z
    if surface <= FIRST_RING:
        k = FIRST_RING - surface
        normal, around, u = round_frame(ring[k, 2], 0.0, x - ring[k, 0], y, z - ring[k, 1])
        return normal, around, down, u, y
    x, z = x - shape[surface, 0], z - shape[surface, 1]
    if shape[surface, 8] == BOX:
        normal, along_u, along_v, u, v = box_frame(shape, surface, face, x, z)
        return normal, along_u, along_v, u, v if face >= TOP_FACE else y
    radius, slope = shape[surface, 4], 0.0
    if shape[surface, 8] == ELLIPSOID:
        slope = (2.0 * radius / (shape[surface, 7] - shape[surface, 6])) ** 2
    centred = y - 0.5 * (shape[surface, 6] + shape[surface, 7])
    normal, around, u = round_frame(radius, slope, x, centred, z)
    return normal, around, down, u, y


@inlined_kernel
def dot(a, b):
    """Inner product of two tuples."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined_kernel
def light(normal):
    """Brightness by orientation: walls that face different ways differ."""
    lit = abs(0.35 * normal[0] - 0.75 * normal[1] + 0.55 * normal[2])
    return 0.72 + 0.28 * lit / math.sqrt(dot(normal, normal))


@inlined_kernel
def sky_footprint(direction, step_x, step_y):
    """Place and footprint on clouds that bend down towards the horizon, infinitely far away."""
    depth = 0.35 - direction[1]
    u, v = direction[0] / depth, direction[2] / depth
    ux, vx = (step_x[0] + u * step_x[1]) / depth, (step_x[2] + v * step_x[1]) / depth
    uy, vy = (step_y[0] + u * step_y[1]) / depth, (step_y[2] + v * step_y[1]) / depth
    major_u, major_v, minor = footprint_axes(ux, uy, vx, vy)
    return u, v, major_u, major_v, minor


@inlined_kernel
def wall_footprint(shape, ring, surface, face, t, origin, direction, step_x, step_y):
    """Place and footprint on a surface, m, and its brightness."""
    normal, along_u, along_v, u, v = surface_frame(
        shape,
        ring,
        surface,
        face,
        origin[0] + t * direction[0],
        origin[1] + t * direction[1],
        origin[2] + t * direction[2],
    )
    facing = dot(normal, direction)
    facing = math.copysign(max(abs(facing), _LEAST_COSINE), facing)
    # A step of the ray moves the point hit by t (step - direction (normal.step / facing)).
    slide_x, slide_y = dot(normal, step_x) / facing, dot(normal, step_y) / facing
    du, dv = dot(along_u, direction), dot(along_v, direction)
    major_u, major_v, minor = footprint_axes(
        t * (dot(along_u, step_x) - slide_x * du),
        t * (dot(along_u, step_y) - slide_y * du),
        t * (dot(along_v, step_x) - slide_x * dv),
        t * (dot(along_v, step_y) - slide_y * dv),
    )
    return u, v, major_u, major_v, minor, light(normal) if surface >= 0 else 1.0


@inlined_kernel
def ray_grey(
    shape,
    ring,
    paint,
    texels,
    texture,
    surface,
    face,
    t,
    origin,
    direction,
    step_x,
    step_y,
):
    """Grey value where a ray ended, averaged over its footprint."""
    # Layers: the pattern, fine noise, coarse noise; the sky has the last only.
    first, pattern, pattern_m = 2, 0, 1.0
    pattern_gain, noise_gain, coarse_m = 0.0, 9.0, 0.012
    if surface == SKY:
        u, v, major_u, major_v, minor = sky_footprint(direction, step_x, step_y)
        grey = 205.0 + 25.0 * (direction[1] + 0.3)
    else:
        u, v, major_u, major_v, minor, brightness = wall_footprint(
            shape, ring, surface, face, t, origin, direction, step_x, step_y
        )
        row = surface if surface >= 0 else shape.shape[0]
        if surface <= FIRST_RING:
            row += 1 + FIRST_RING - surface
        grey = paint[row, 0] * brightness
        pattern, pattern_m = int(paint[row, 1]), paint[row, 2]
        pattern_gain, noise_gain, coarse_m = paint[row, 3], paint[row, 4], COARSE_M
        u, v = u + paint[row, 5], v + paint[row, 6]
        first = 1 if pattern_gain == 0.0 or face >= TOP_FACE else 0
    for layer in range(first, 3):
        index, gain, scale, shift = NOISE, noise_gain, 1.0 / coarse_m, FACE_SHIFT_M * face
        if layer == 0:
            index, gain, scale, shift = pattern, pattern_gain, 1.0 / pattern_m, 0.0
        elif layer == 1:
            scale = 1.0 / FINE_M
        grey += gain * filtered(
            texels,
            texture,
            index,
            (u + shift) * scale,
            (v - shift) * scale,
            major_u * scale,
            major_v * scale,
            minor * scale,
        )
    return grey
