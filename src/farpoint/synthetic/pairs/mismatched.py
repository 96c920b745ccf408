"""Pairs with many outliers: anywhere, near the true point, of repeated structure, along edges."""

from __future__ import annotations

import numpy as np

from farpoint.camera import Camera
from farpoint.geometry import so3, sphere
from farpoint.synthetic.pairs.pair import HardPair, of_scene, seen, vga_camera
from farpoint.synthetic.points import PointSceneOptions, make_point_scene

__all__ = ["court", "junk", "rails", "road", "wide_baseline"]

# Walls of the courtyard: centres, m, unit vectors along the walls, and half widths, m.
_CENTERS = np.array([[0.0, 0.0, 22.0], [-7.0, 0.0, 17.0], [7.0, 0.0, 17.0]])
_ALONG = np.array([[1.0, 0.0, 0.0], [0.35, 0.0, 0.94], [0.35, 0.0, -0.94]])
_HALF_WIDTHS = np.array([6.0, 3.0, 3.0])
_WINDOWS_M, _STOREY_M = 1.5, 2.7


def road(seed: int) -> HardPair:
    """A road ahead: 45 matches at 25 to 120 m, 22 of them outliers, and a translation of 9 m.

    The errors of the outliers are normal, with a 1-sigma of 15 px in each coordinate.
    """
    options = PointSceneOptions(
        camera=Camera.pinhole(800, 120, 718.0, 718.0, 400.0, 60.0),
        matches=45,
        outliers=0,
        far_share=0.0,
        near_range_m=(25.0, 120.0),
        rotation_vector_rad=(0.002, 0.006, -0.001),
        translation_m=(0.1, -0.05, -9.0),
        noise_px=0.4,
    )
    scene, rng = make_point_scene(options, seed=seed), np.random.default_rng(seed + 1000)
    wrong = rng.permutation(45)[:22]
    points1 = scene.points1.copy()
    points1[wrong] += rng.normal(0.0, 15.0, (22, 2))
    return of_scene(scene, points1, np.isin(np.arange(45), wrong))


def court(seed: int, *, matches: int, repeated: float, whole: bool = False) -> HardPair:
    """A courtyard with windows: a share ``repeated`` of the matches is on the wrong window.

    The two images are 5 m and 14 degrees apart, and the noise is 0.3 px. The windows of a wall are
    1.5 m apart. Each wrong match is off by -1, 1 or 2 windows. With ``whole``, ``repeated`` is the
    share of windows on which all matches are wrong, each by 1 window.
    """
    camera = Camera.pinhole(3072, 2048, 2760.0, 2760.0, 1535.5, 1023.5)
    assert camera.size is not None
    rng, n = np.random.default_rng(seed), 3 * matches
    side = rng.integers(0, 3, n)
    along, up = rng.uniform(-1.0, 1.0, n) * _HALF_WIDTHS[side], rng.uniform(-4.0, 4.0, n)
    X = _CENTERS[side] + along[:, None] * _ALONG[side]
    X += np.c_[np.zeros(n), up, rng.normal(0.0, 0.15, n)]
    if whole:
        places = np.c_[side, np.floor(along / _WINDOWS_M), np.floor(up / _STOREY_M)]
        windows, window = np.unique(places, axis=0, return_inverse=True)
        shift = _WINDOWS_M * (rng.uniform(size=len(windows)) < repeated)[window.ravel()]
    else:
        is_repeated = rng.uniform(size=n) < repeated
        shift = _WINDOWS_M * rng.choice([-1.0, 1.0, 2.0], n) * is_repeated
    R = so3.exp(np.array([0.02, -0.25, 0.01]) + rng.normal(0.0, 0.02, 3))
    center = np.array([5.0, 0.3, 1.5]) + rng.normal(0.0, 0.3, 3)
    views = X, (X + shift[:, None] * _ALONG[side] - center) @ R.T
    points = [camera.project(view) + rng.normal(0.0, 0.3, (n, 2)) for view in views]
    inside = np.all([(p > 0.0).all(1) & (p < camera.size).all(1) for p in points], axis=0)
    points0, points1 = (p[inside][:matches] for p in points)
    return HardPair(
        camera=camera,
        points0=points0,
        points1=points1,
        is_outlier=(shift != 0.0)[inside][:matches],
        rotation_cam1_from_cam0=R,
        translation_cam1_from_cam0=-R @ center,
    )


def rails(seed: int, *, share: float = 0.5, matches: int = 200) -> HardPair:
    """A drive along rails: a share of the matches slides along the images of the rails.

    The camera is 2 m above four rails that are parallel to the direction of travel. The camera
    moves by 0.5 m and rotates by up to 1 degree about each axis. A match that slides is displaced
    along the image of its rail by 0.5 to 2 px. The displacement is equal for all matches of a rail
    up to normal noise of 0.2 px.
    """
    rng, camera = np.random.default_rng([seed, 19]), vga_camera()
    sliding = round(share * matches)
    rail = rng.integers(0, 4, sliding)
    aside, ahead = np.array([-2.5, -1.0, 1.0, 2.5])[rail], rng.uniform(4.0, 20.0, sliding)
    on_rails = np.c_[aside, np.full(sliding, 2.0), ahead]
    elsewhere = camera.unproject(rng.uniform((0.0, 0.0), (639.0, 300.0), (matches - sliding, 2)))
    elsewhere *= rng.uniform(6.0, 60.0, matches - sliding)[:, None]
    points = np.concatenate([on_rails, elsewhere])
    R = so3.exp(np.radians(rng.uniform(-1.0, 1.0, 3)))
    t = np.array([0.02, 0.0, -0.5])
    depth = np.linalg.norm(points, axis=1)
    pair = seen(camera, camera.project(points), depth, R, t, rng, 0.2)
    return _slid(pair, on_rails, rail, rng)


def _slid(
    pair: HardPair, on_rails: np.ndarray, rail: np.ndarray, rng: np.random.Generator
) -> HardPair:
    """The pair with its first points displaced along the images of their rails."""
    R, t = pair.rotation_cam1_from_cam0, pair.translation_cam1_from_cam0
    ends = [
        pair.camera.project((X @ R.T) + t) for X in (on_rails, on_rails + np.array([0.0, 0.0, 0.1]))
    ]
    along = sphere.normalize(np.c_[ends[1] - ends[0], np.zeros(len(rail))])[:, :2]
    size = rng.uniform(0.5, 2.0, 4)[rail] + rng.normal(0.0, 0.2, len(rail))
    pair.points1[: len(rail)] += size[:, None] * along
    pair.is_outlier[: len(rail)] = True
    return pair


def wide_baseline(
    seed: int, *, camera: Camera, baseline_m: float, turn_deg: float, matches: int, outliers: int
) -> HardPair:
    """Points at 1.5 to 4 m, with a large rotation and a large translation.

    The rotation is ``turn_deg`` about a random axis. The translation has the length ``baseline_m``
    and a random direction.
    """
    turn, move = sphere.normalize(np.random.default_rng([seed, 3]).normal(size=(2, 3)))
    options = PointSceneOptions(
        camera=camera,
        matches=matches,
        outliers=outliers,
        far_share=0.0,
        near_range_m=(1.5, 4.0),
        rotation_vector_rad=tuple(np.radians(turn_deg) * turn),
        translation_m=tuple(baseline_m * move),
        noise_px=0.3,
    )
    scene = make_point_scene(options, seed=seed)
    return of_scene(scene, scene.points1)


def junk(seed: int, *, matches: int = 110) -> HardPair:
    """Random matches only, all of them outliers; the true motion is zero."""
    rng, camera = np.random.default_rng([seed, 23]), vga_camera()
    points0, points1 = rng.uniform((0.0, 0.0), (639.0, 479.0), (2, matches, 2))
    return HardPair(
        camera=camera,
        points0=points0,
        points1=points1,
        is_outlier=np.ones(matches, bool),
        rotation_cam1_from_cam0=np.eye(3),
        translation_cam1_from_cam0=np.zeros(3),
    )
