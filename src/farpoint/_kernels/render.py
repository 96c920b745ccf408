"""Grey values of a scene: one ray per pixel, sixteen where the pixel or a neighbour has an edge.

Textures are filtered over the footprint of the pixel (`farpoint._kernels.texture`), silhouettes by
supersampling, so that what moves by a fraction of a pixel looks as if it did.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import kernel
from farpoint._kernels.raycast import TOP_FACE, trace
from farpoint._kernels.scene_arrays import BOX, CYLINDER, GROUND, NOTHING, SKY, SceneArrays
from farpoint._kernels.texture import filtered, footprint_axes

__all__ = ["render"]

NOISE = 0  # texture of the noise that lies over every surface, at two scales
FINE_M = 0.011  # metres per texel
COARSE_M = 0.23
EDGE_SAMPLES = 4  # per axis
EDGE_REACH = 0.66  # px from the centre: with the weights, a filter a little wider than a pixel


@kernel
def box_frame(shape, face, x, y, z):
    """Normal, unit vectors of texture u and v, and u, v of a point on a box (see `surface_frame`)."""
    cos, sin = shape[2], shape[3]
    px = (x - shape[0]) * cos + (z - shape[1]) * sin
    pz = (z - shape[1]) * cos - (x - shape[0]) * sin
    if face >= TOP_FACE:
        return (0.0, 1.0, 0.0), (cos, 0.0, sin), (-sin, 0.0, cos), px, pz
    down = (0.0, 1.0, 0.0)
    if face < 2:
        return (cos, 0.0, sin), (-sin, 0.0, cos), down, pz, y
    return (-sin, 0.0, cos), (cos, 0.0, sin), down, px, y


@kernel
def surface_frame(scene, surface, face, x, y, z):
    """Normal (either sign), unit vectors along texture u and v, and u, v in metres."""
    down = (0.0, 1.0, 0.0)
    if surface == GROUND:
        return down, (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), x, z
    if surface >= 0 and scene.kind[surface] == BOX:
        return box_frame(scene.shape[surface], face, x, y, z)
    # Round things: u runs around the axis.
    if surface >= 0:
        centre_x, centre_z = scene.shape[surface, 0], scene.shape[surface, 1]
        radius = scene.shape[surface, 4]
    else:
        ring = -4 - surface
        centre_x, centre_z, radius = scene.ring[ring, 0], scene.ring[ring, 1], scene.ring[ring, 2]
    px, pz = x - centre_x, z - centre_z
    across = math.sqrt(px * px + pz * pz) + 1e-12
    outward = (px / across, 0.0, pz / across)
    around = (pz / across, 0.0, -px / across)
    u = radius * math.atan2(px, pz)
    if surface >= 0 and scene.kind[surface] != CYLINDER:
        top, bottom = scene.shape[surface, 6], scene.shape[surface, 7]
        squash = 2.0 * radius / (bottom - top)
        ny = (y - 0.5 * (top + bottom)) * squash * squash / across
        return (outward[0], ny, outward[2]), around, down, u, y
    return outward, around, down, u, y


@kernel
def project_step(normal, axis, direction, step, t, facing):
    """Shift along ``axis`` of the point hit when the ray's direction changes by ``step``."""
    slide = (normal[0] * step[0] + normal[1] * step[1] + normal[2] * step[2]) / facing
    return t * (
        axis[0] * (step[0] - slide * direction[0])
        + axis[1] * (step[1] - slide * direction[1])
        + axis[2] * (step[2] - slide * direction[2])
    )


@kernel
def sky_grey(scene, direction, step_x, step_y):
    """Clouds on a plane overhead, bent down towards the horizon; infinitely far away."""
    depth = 0.35 - direction[1]
    scale = 260.0  # texels of the noise from the zenith outwards
    u, v = scale * direction[0] / depth, scale * direction[2] / depth
    ux = (scale * step_x[0] + u * step_x[1]) / depth
    vx = (scale * step_x[2] + v * step_x[1]) / depth
    uy = (scale * step_y[0] + u * step_y[1]) / depth
    vy = (scale * step_y[2] + v * step_y[1]) / depth
    major_u, major_v, minor = footprint_axes(ux, uy, vx, vy)
    clouds = filtered(scene, NOISE, u, v, major_u, major_v, minor)
    return 205.0 + 25.0 * (direction[1] + 0.3) + 16.0 * clouds


@kernel
def light(normal, surface):
    """Brightness by orientation: walls that face different ways differ."""
    if surface < 0:
        return 1.0
    length = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    return 0.72 + 0.28 * abs(0.35 * normal[0] - 0.75 * normal[1] + 0.55 * normal[2]) / length


@kernel
def surface_grey(scene, surface, face, t, origin, direction, step_x, step_y):
    """Grey value of a surface over the footprint that ``step_x``, ``step_y`` span."""
    x, y, z = (
        origin[0] + t * direction[0],
        origin[1] + t * direction[1],
        origin[2] + t * direction[2],
    )
    normal, along_u, along_v, u, v = surface_frame(scene, surface, face, x, y, z)
    facing = normal[0] * direction[0] + normal[1] * direction[1] + normal[2] * direction[2]
    facing = math.copysign(max(abs(facing), 0.02), facing)
    major_u, major_v, minor = footprint_axes(
        project_step(normal, along_u, direction, step_x, t, facing),
        project_step(normal, along_u, direction, step_y, t, facing),
        project_step(normal, along_v, direction, step_x, t, facing),
        project_step(normal, along_v, direction, step_y, t, facing),
    )
    shapes = scene.kind.shape[0]
    paint = scene.paint[surface if surface >= 0 else shapes + (0 if surface == GROUND else -3 - surface)]
    u, v = u + paint[5], v + paint[6]
    grey = paint[0] * light(normal, surface)
    if paint[3] != 0.0 and (surface < 0 or face < TOP_FACE):
        scale = 1.0 / paint[2]
        grey += paint[3] * filtered(
            scene, int(paint[1]), u * scale, v * scale, major_u * scale, major_v * scale, minor * scale
        )
    shift = 7.3 * face  # metres: every face has its own part of the noise
    for metres in (FINE_M, COARSE_M):
        scale = 1.0 / metres
        grey += paint[4] * filtered(
            scene,
            NOISE,
            (u + shift) * scale,
            (v - shift) * scale,
            major_u * scale,
            major_v * scale,
            minor * scale,
        )
    return grey


@kernel
def ray_grey(scene, surface, face, t, origin, direction, step_x, step_y):
    """Grey value where a ray ended."""
    if surface == SKY:
        return sky_grey(scene, direction, step_x, step_y)
    return surface_grey(scene, surface, face, t, origin, direction, step_x, step_y)


@kernel
def turned(R, x, y, z):
    """``R @ (x, y, z)``."""
    return (
        R[0, 0] * x + R[0, 1] * y + R[0, 2] * z,
        R[1, 0] * x + R[1, 1] * y + R[1, 2] * z,
        R[2, 0] * x + R[2, 1] * y + R[2, 2] * z,
    )


@kernel
def cast_pixels(scene, world_from_cam, rays, steps, image, depth, surfaces):
    """One ray per pixel: grey, distance, and the number of the face it hit."""
    R, origin = world_from_cam[:3, :3], (world_from_cam[0, 3], world_from_cam[1, 3], world_from_cam[2, 3])
    for row in range(rays.shape[0]):
        for column in range(rays.shape[1]):
            ray, step = rays[row, column], steps[row, column]
            if math.isnan(ray[0] + step[0, 0] + step[0, 1]):
                image[row, column], depth[row, column] = 0.0, math.nan
                surfaces[row, column] = 8 * NOTHING
                continue
            direction = turned(R, ray[0], ray[1], ray[2])
            step_x = turned(R, step[0, 0], step[1, 0], step[2, 0])
            step_y = turned(R, step[0, 1], step[1, 1], step[2, 1])
            t, surface, face = trace(
                scene, origin[0], origin[1], origin[2], direction[0], direction[1], direction[2]
            )
            depth[row, column], surfaces[row, column] = t, 8 * surface + face
            image[row, column] = ray_grey(
                scene, surface, face, t, origin, direction, step_x, step_y
            )


@kernel
def is_edge(surfaces, row, column):
    """Whether a pixel or one of its eight neighbours shows another face."""
    here = surfaces[row, column]
    if here == 8 * NOTHING:
        return False
    for j in range(max(row - 1, 0), min(row + 2, surfaces.shape[0])):
        for i in range(max(column - 1, 0), min(column + 2, surfaces.shape[1])):
            if surfaces[j, i] != here:
                return True
    return False


@kernel
def edge_grey(scene, R, origin, ray, step):
    """Mean grey of many rays through one pixel, those near its centre counting most."""
    total, weights = 0.0, 0.0
    share = 2.0 * EDGE_REACH / EDGE_SAMPLES
    step_x = turned(R, share * step[0, 0], share * step[1, 0], share * step[2, 0])
    step_y = turned(R, share * step[0, 1], share * step[1, 1], share * step[2, 1])
    centre = turned(R, ray[0], ray[1], ray[2])
    for k in range(EDGE_SAMPLES * EDGE_SAMPLES):
        a = k % EDGE_SAMPLES - 0.5 * (EDGE_SAMPLES - 1)
        b = k // EDGE_SAMPLES - 0.5 * (EDGE_SAMPLES - 1)
        direction = (
            centre[0] + a * step_x[0] + b * step_y[0],
            centre[1] + a * step_x[1] + b * step_y[1],
            centre[2] + a * step_x[2] + b * step_y[2],
        )
        t, surface, face = trace(
            scene, origin[0], origin[1], origin[2], direction[0], direction[1], direction[2]
        )
        weight = math.exp(-1.5 * share * share * (a * a + b * b))
        total += weight * ray_grey(scene, surface, face, t, origin, direction, step_x, step_y)
        weights += weight
    return total / weights


@kernel
def render(
    scene: SceneArrays,
    world_from_cam: np.ndarray,
    rays: np.ndarray,
    steps: np.ndarray,
    image: np.ndarray,
    depth: np.ndarray,
    surfaces: np.ndarray,
) -> None:
    """Fill ``image`` with grey values and ``depth`` with distances along the rays.

    Parameters
    ----------
    scene : SceneArrays
    world_from_cam : ndarray, shape (4, 4)
    rays : ndarray, shape (H, W, 3)
        Unit rays of the pixel centres in camera axes; NaN where there is none.
    steps : ndarray, shape (H, W, 3, 2)
        Change of the ray by a pixel to the right and a pixel down.
    image : ndarray of float32, shape (H, W)
        Out: grey values, about 0 to 255, not rounded; 0 where there is no ray.
    depth : ndarray, shape (H, W)
        Out: m; infinite for the sky, NaN where there is no ray.
    surfaces : ndarray of int64, shape (H, W)
        Out: eight times the number of the surface, plus its face.
    """
    cast_pixels(scene, world_from_cam, rays, steps, image, depth, surfaces)
    R, origin = world_from_cam[:3, :3], (world_from_cam[0, 3], world_from_cam[1, 3], world_from_cam[2, 3])
    for row in range(rays.shape[0]):
        for column in range(rays.shape[1]):
            if is_edge(surfaces, row, column):
                image[row, column] = edge_grey(
                    scene, R, origin, rays[row, column], steps[row, column]
                )
