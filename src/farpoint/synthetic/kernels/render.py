"""Images of a scene: one ray per pixel, or 16 rays if a neighbouring pixel shows another face.

Textures are filtered over the footprint of the pixel (`farpoint.synthetic.kernels.texture`).
Silhouettes are supersampled. A motion by a fraction of a pixel therefore changes the image as in a
real camera.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import inlined_kernel, kernel, step_kernel
from farpoint._kernels.vectors import Vector
from farpoint.synthetic.kernels.constants import (
    EDGE_FOOTPRINT,
    EDGE_HALF_WIDTH_PX,
    EDGE_SAMPLES,
    NOTHING,
    PIXEL_CENTRE,
)
from farpoint.synthetic.kernels.raycast import Hit, Ray, trace
from farpoint.synthetic.kernels.scene_arrays import Scene
from farpoint.synthetic.kernels.surfaces import RayDifferential, ray_grey

__all__ = ["render"]


def tent_offsets(count: int, half_width: float) -> np.ndarray:
    """Offsets (count, 2), px, with a tent distribution, from a warped rank-1 lattice.

    All x are different, and all y are different. An edge along a row or a column is therefore
    sampled at ``count`` different distances.
    """
    lattice = np.stack([np.arange(count), 7 * np.arange(count) % count], axis=1)
    share = (lattice + 0.5) / count
    tail = half_width * (1.0 - np.sqrt(2.0 * np.minimum(share, 1.0 - share)))
    return np.where(share < 0.5, -tail, tail)


EDGE_OFFSETS = tent_offsets(EDGE_SAMPLES, EDGE_HALF_WIDTH_PX)


@inlined_kernel
def rotated(R: np.ndarray, x: float, y: float, z: float) -> Vector:
    """``R @ (x, y, z)``."""
    return (
        R[0, 0] * x + R[0, 1] * y + R[0, 2] * z,
        R[1, 0] * x + R[1, 1] * y + R[1, 2] * z,
        R[2, 0] * x + R[2, 1] * y + R[2, 2] * z,
    )


@step_kernel
def is_edge(surfaces: np.ndarray, row: int, column: int) -> bool:
    """Whether one of the eight neighbours of a pixel shows another face than the pixel."""
    here = surfaces[row, column]
    if here == 8 * NOTHING:
        return False
    for j in range(max(row - 1, 0), min(row + 2, surfaces.shape[0])):
        for i in range(max(column - 1, 0), min(column + 2, surfaces.shape[1])):
            if surfaces[j, i] != here:
                return True
    return False


@step_kernel
def pixel_grey(
    scene: Scene,
    pose: np.ndarray,
    ray: np.ndarray,
    step: np.ndarray,
    offsets: np.ndarray,
    footprint: float,
) -> tuple[float, Hit]:
    """Mean grey value of the rays at ``offsets`` from the pixel's centre.

    The function also returns the surface that the last ray hits.
    """
    centre = rotated(pose, ray[0], ray[1], ray[2])
    right = rotated(pose, step[0, 0], step[1, 0], step[2, 0])
    down = rotated(pose, step[0, 1], step[1, 1], step[2, 1])
    differential = RayDifferential(
        (footprint * right[0], footprint * right[1], footprint * right[2]),
        (footprint * down[0], footprint * down[1], footprint * down[2]),
    )
    origin = pose[0, 3], pose[1, 3], pose[2, 3]
    total, hit = 0.0, Hit(0.0, NOTHING, 0)
    for k in range(len(offsets)):
        a, b = offsets[k, 0], offsets[k, 1]
        dx = centre[0] + a * right[0] + b * down[0]
        dy = centre[1] + a * right[1] + b * down[1]
        dz = centre[2] + a * right[2] + b * down[2]
        beam = Ray(origin, (dx, dy, dz))
        hit = trace(scene.blocks, scene.hills, beam)
        total += ray_grey(scene.blocks, scene.hills, scene.finish, beam, differential, hit)
    return total / len(offsets), hit


@kernel
def render(
    scene: Scene,
    world_from_row: np.ndarray,
    rays: np.ndarray,
    steps: np.ndarray,
    image: np.ndarray,
    depth: np.ndarray,
    surfaces: np.ndarray,
) -> None:
    """Fill ``image`` with grey values and ``depth`` with distances along the rays.

    Parameters
    ----------
    scene : Scene
    world_from_row : ndarray, shape (H, 4, 4)
        Pose ``world_from_cam`` of each row, at the time at which it is read.
    rays : ndarray, shape (H, W, 3)
        Unit rays of the pixel centres in camera axes; NaN if a pixel has no ray.
    steps : ndarray, shape (H, W, 3, 2)
        Change of the ray to the next pixel on the right, and to the next pixel below.
    image : ndarray of float32, shape (H, W)
        Out: grey values, about 0 to 255, not rounded; 0 if a pixel has no ray.
    depth : ndarray, shape (H, W)
        Out: distance along the ray, m; infinite for the sky, NaN if a pixel has no ray.
    surfaces : ndarray of int64, shape (H, W)
        Out: eight times the number of the surface, plus the number of the face.
    """
    rows, columns = depth.shape
    for sweep in range(2):  # all pixels with one ray, then the pixels at edges with 16 rays
        offsets, footprint = (PIXEL_CENTRE, 1.0) if sweep == 0 else (EDGE_OFFSETS, EDGE_FOOTPRINT)
        for row in range(rows):
            pose = world_from_row[row]
            for column in range(columns):
                ray, step = rays[row, column], steps[row, column]
                if math.isnan(ray[0] + step[0, 0] + step[0, 1]):
                    image[row, column], depth[row, column] = 0.0, math.nan
                    surfaces[row, column] = 8 * NOTHING
                elif sweep == 0 or is_edge(surfaces, row, column):
                    grey, hit = pixel_grey(scene, pose, ray, step, offsets, footprint)
                    image[row, column] = grey
                    if sweep == 0:
                        depth[row, column] = hit.distance
                        surfaces[row, column] = 8 * hit.surface + hit.face
