"""Pairs with all or nearly all points on a plane: two motions may fit (planar ambiguity)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from farpoint.camera import Camera
from farpoint.geometry import so3, sphere
from farpoint.synthetic.pairs.pair import HardPair, seen, vga_camera

__all__ = ["floor", "ground_below", "rough_wall", "wall", "wall_ahead"]

_WALL_NORMAL = np.array([0.45, -0.25, 1.0]) / 4.0  # n of the plane n . X = 1, 1/m
_NOISE_PX = 0.2


def wall(seed: int, *, direction: ArrayLike, off_plane: int = 0, matches: int = 100) -> HardPair:
    """A wall 4 m away, ``off_plane`` points in front of the wall, and a translation of 12 cm.

    ``direction`` (3,) is the true direction_cam1_from_cam0.
    """
    rng, camera = np.random.default_rng(seed), vga_camera()
    points0 = _pixels(rng, matches)
    depth = 1.0 / (camera.unproject(points0) @ _WALL_NORMAL)
    depth[:off_plane] *= rng.uniform(0.5, 0.8, off_plane)
    return seen(
        camera, points0, depth, _turn(rng, 3.0), 0.12 * np.asarray(direction), rng, _NOISE_PX
    )


def rough_wall(seed: int, *, matches: int, relief: float, outlier_share: float = 0.0) -> HardPair:
    """A wall of random slope, 4 m away, with relief and outliers.

    ``relief`` is the 1-sigma of the relative deviation of each depth from the plane. The
    translation of 12 cm has a random direction. Outliers lie anywhere in image 1.
    """
    rng, camera = np.random.default_rng([seed, matches]), vga_camera()
    points0 = _pixels(rng, matches)
    normal = sphere.normalize(np.r_[rng.normal(0.0, 0.4, 2), 1.0])
    depth = np.clip(4.0 / (camera.unproject(points0) @ normal), 0.5, 40.0)
    depth *= 1.0 + relief * rng.normal(size=matches)
    R, direction = _turn(rng, 3.0), sphere.normalize(rng.normal(size=3))
    pair = seen(camera, points0, depth, R, 0.12 * direction, rng, _NOISE_PX)
    wrong = round(outlier_share * len(pair))
    pair.points1[:wrong] = _pixels(np.random.default_rng(seed), wrong)
    pair.is_outlier[:wrong] = True
    return pair


def wall_ahead(seed: int, *, matches: int, relief: float) -> HardPair:
    """A wall 2 m away, and a translation of 20 cm towards the wall or away from it.

    The translation is within 12 degrees of the normal of the wall. ``relief`` is the 1-sigma of the
    relative deviation of each depth from the plane.
    """
    rng, camera = np.random.default_rng([seed, matches, 11]), vga_camera()
    points0 = _pixels(rng, matches)
    normal = sphere.normalize(np.r_[rng.normal(0.0, 0.3, 2), 1.0])
    depth = 2.0 / (camera.unproject(points0) @ normal) * (1.0 + relief * rng.normal(size=matches))
    axis = sphere.normalize(np.cross(normal, rng.normal(size=3)))
    R = _turn(rng, 3.0)
    ahead = so3.exp(np.radians(rng.uniform(0.0, 12.0)) * axis) @ normal
    direction = rng.choice([-1.0, 1.0]) * R @ ahead
    return seen(camera, points0, depth, R, 0.2 * direction, rng, 0.22)


def floor(seed: int) -> HardPair:
    """300 points on a floor 1.5 m below a wide-angle camera, and a translation of 5 cm.

    The translation is mostly horizontal.
    """
    rng = np.random.default_rng([seed, 13])
    camera = Camera.pinhole(640, 480, 250.0, 250.0, 319.5, 239.5)
    points0 = rng.uniform((0.0, 250.0), (639.0, 479.0), (300, 2))
    depth = 1.5 / camera.unproject(points0)[:, 1]
    direction = sphere.normalize(rng.normal(size=3) * (1.0, 0.3, 1.0))
    return seen(camera, points0, depth, _turn(rng, 2.0), 0.05 * direction, rng, _NOISE_PX)


def ground_below(seed: int) -> HardPair:
    """200 points on the ground 100 m below a drone that looks down, and a translation of 27 m.

    The translation is mostly horizontal.
    """
    rng, camera = np.random.default_rng([seed, 17]), vga_camera()
    points0 = _pixels(rng, 200)
    depth = 100.0 / camera.unproject(points0)[:, 2] * (1.0 + 0.003 * rng.normal(size=200))
    direction = sphere.normalize(rng.normal(size=3) * (1.0, 1.0, 0.2))
    return seen(camera, points0, depth, _turn(rng, 5.0), 27.0 * direction, rng, 0.3)


def _pixels(rng: np.random.Generator, count: int) -> np.ndarray:
    return rng.uniform((0.0, 0.0), (639.0, 479.0), (count, 2))


def _turn(rng: np.random.Generator, most_deg: float) -> np.ndarray:
    """Random rotation with a rotation vector of up to ``most_deg`` along each axis."""
    return so3.exp(np.radians(rng.uniform(-most_deg, most_deg, 3)))
