"""Pairs with an independently moving object, or with matches that stand still in the image."""

from __future__ import annotations

import numpy as np

from farpoint.geometry import so3
from farpoint.synthetic.pairs.pair import HardPair, of_scene, vga_camera
from farpoint.synthetic.points import PointScene, PointSceneOptions, make_point_scene

__all__ = ["crossing", "stationary", "traffic"]

_NOISE_PX = 0.2


def traffic(seed: int, *, share: float, shift_px: float, matches: int = 300) -> HardPair:
    """Near and far points, and a moving object with the share ``share`` of the matches.

    All matches of the object are displaced in image 1 by ``shift_px`` in the same direction.
    """
    rng = np.random.default_rng(seed)
    options = PointSceneOptions(
        camera=vga_camera(),
        matches=matches,
        outliers=0,
        rotation_vector_rad=(0.02, -0.03, 0.01),
        translation_m=tuple(rng.normal(0.0, 0.1, 3)),
        noise_px=_NOISE_PX,
    )
    scene = make_point_scene(options, seed=seed)
    middle, angle = scene.points0[rng.integers(matches)], rng.uniform(0.0, 2.0 * np.pi)
    nearest = np.argsort(np.linalg.norm(scene.points0 - middle, axis=1))
    moves = np.isin(np.arange(matches), nearest[: round(share * matches)])
    points1 = scene.points1 + shift_px * np.outer(moves, [np.cos(angle), np.sin(angle)])
    return of_scene(scene, points1, moves)


def crossing(seed: int, *, share: float, at_rest: bool, matches: int = 300) -> HardPair:
    """One compact moving object with the share ``share`` of the matches.

    The object hides the points behind it and moves by about 1 m, mostly horizontally. The camera
    moves by 0.6 m, or is ``at_rest``.
    """
    rng, camera = np.random.default_rng(seed), vga_camera()
    assert camera.size is not None
    theta, t = (0.002, -0.01, 0.001), (0.05, 0.0, -0.6)
    if at_rest:
        theta = t = (0.0, 0.0, 0.0)
    options = PointSceneOptions(
        camera=camera,
        matches=matches,
        outliers=0,
        near_range_m=(4.0, 30.0),
        far_share=0.3,
        rotation_vector_rad=theta,
        translation_m=t,
        noise_px=_NOISE_PX,
    )
    scene, count = make_point_scene(options, seed=seed), round(share * matches)
    center = np.array([rng.uniform(-2, 2), rng.uniform(-0.5, 0.5), rng.uniform(6, 12)])
    width = 0.45 * np.sqrt(share) * center[2]
    X = center + rng.uniform(-1, 1, (count, 3)) * [width, 0.7 * width, 0.8]
    moved = X + rng.normal(0.0, 1.0, 3) * [0.9, 0.09, 0.9]
    R = so3.exp(np.array(theta))
    ends = camera.project(X), camera.project(moved @ R.T + np.array(t))
    first, second = (end + rng.normal(0.0, _NOISE_PX, end.shape) for end in ends)
    hidden = np.all((scene.points0 > first.min(0)) & (scene.points0 < first.max(0)), axis=1)
    kept = np.flatnonzero(~hidden)[: matches - count]
    points0 = np.concatenate([scene.points0[kept], first])
    points1 = np.concatenate([scene.points1[kept], second])
    inside = np.all((points0 > 0) & (points1 > 0), axis=1)
    inside &= np.all((points0 < camera.size) & (points1 < camera.size), axis=1)
    return HardPair(
        camera=camera,
        points0=points0[inside],
        points1=points1[inside],
        is_outlier=(np.arange(len(points0)) >= len(kept))[inside],
        rotation_cam1_from_cam0=R,
        translation_cam1_from_cam0=np.array(t),
    )


def stationary(scene: PointScene, seed: int, *, share: float, noise_px: float = 0.22) -> HardPair:
    """A scene through a dirty lens: a share ``share`` of the matches stands still in the image."""
    rng = np.random.default_rng(seed)
    rows = rng.permutation(len(scene))[: round(share * len(scene))]
    points1 = scene.points1.copy()
    points1[rows] = scene.points0[rows] + rng.normal(0.0, noise_px, (len(rows), 2))
    stands_still = np.isin(np.arange(len(scene)), rows)
    return of_scene(scene, points1, scene.is_outlier | stands_still)
