"""One compact object that moves by itself, before a camera that moves or does not."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from farpoint import Camera, PoseStatus, RelativePose, estimate_relative_pose
from farpoint.geometry import so3
from farpoint.pose import two_views
from farpoint.pose.one_object import is_one_object
from farpoint.synthetic import PointSceneOptions, make_point_scene

CAMERA = Camera.pinhole(640, 480, 500.0, 500.0, 319.5, 239.5)
NOISE_PX, MATCHES = 0.2, 300


class Crossing(NamedTuple):
    points0: np.ndarray
    points1: np.ndarray
    R: np.ndarray
    t: np.ndarray

    def pose(self) -> RelativePose:
        return estimate_relative_pose(self.points0, self.points1, CAMERA)


def crossing(seed: int, share: float, *, at_rest: bool) -> Crossing:
    """An object with this share of the matches, and nothing seen through it."""
    rng = np.random.default_rng(seed)
    theta, t = ((0.0,) * 3,) * 2 if at_rest else ((0.002, -0.01, 0.001), (0.05, 0.0, -0.6))
    options = PointSceneOptions(
        camera=CAMERA,
        matches=MATCHES,
        outliers=0,
        near_range_m=(4.0, 30.0),
        far_share=0.3,
        rotation_vector_rad=theta,
        translation_m=t,
        noise_px=NOISE_PX,
    )
    scene, count = make_point_scene(options, seed=seed), round(share * MATCHES)
    center = np.array([rng.uniform(-2, 2), rng.uniform(-0.5, 0.5), rng.uniform(6, 12)])
    width = 0.45 * np.sqrt(share) * center[2]
    X = center + rng.uniform(-1, 1, (count, 3)) * [width, 0.7 * width, 0.8]
    moved = X + rng.normal(0.0, 1.0, 3) * [0.9, 0.09, 0.9]
    R = so3.exp(np.array(theta))
    ends = CAMERA.project(X), CAMERA.project(moved @ R.T + np.array(t))
    first, second = (end + rng.normal(0.0, NOISE_PX, end.shape) for end in ends)
    hidden = np.all((scene.points0 > first.min(0)) & (scene.points0 < first.max(0)), axis=1)
    kept = np.flatnonzero(~hidden)[: MATCHES - count]
    points0 = np.concatenate([scene.points0[kept], first])
    points1 = np.concatenate([scene.points1[kept], second])
    inside = np.all((points0 > 0) & (points1 > 0), axis=1)
    inside &= np.all((points0 < CAMERA.size) & (points1 < CAMERA.size), axis=1)
    return Crossing(points0[inside], points1[inside], R, np.array(t))


@pytest.mark.parametrize("share", [0.05, 0.1, 0.2])
def test_a_camera_at_rest_has_no_sure_direction(share):
    poses = [crossing(seed, share, at_rest=True).pose() for seed in range(30)]
    assert sum(pose.status is PoseStatus.OK for pose in poses) <= 2


def wrong_directions(scenes: list[Crossing]) -> int:
    """How many are off by more than 10 degrees."""
    count = 0
    for scene in scenes:
        direction = scene.pose().direction_cam1_from_cam0
        if direction is not None:
            cosine = float(direction @ scene.t) / float(np.linalg.norm(scene.t))
            count += cosine < np.cos(np.radians(10.0))
    return count


def test_fewer_directions_are_those_of_an_object_with_much_of_the_matches(monkeypatch):
    scenes = [crossing(seed, 0.4, at_rest=False) for seed in range(40)]
    with_split = wrong_directions(scenes)
    monkeypatch.setattr(two_views, "dominant_motion", lambda _matches, fit, *_: fit)
    alone = wrong_directions(scenes)
    assert alone >= 25
    assert with_split <= 0.75 * alone


def test_near_points_all_over_the_image_are_no_object():
    rng = np.random.default_rng(0)
    rays = CAMERA.unproject(rng.uniform((0, 0), CAMERA.size, (200, 2)))
    labels = np.where(rng.uniform(size=200) < 0.1, 2, 1).astype(np.uint8)
    assert not is_one_object(rays, labels)
    together = np.argsort(np.linalg.norm(rays - rays[7], axis=1))[:20]
    labels = np.ones(200, np.uint8)
    labels[together] = 2
    assert is_one_object(rays, labels)
    # Far points between them are seen past no object.
    labels[together[::2]] = 1
    assert not is_one_object(rays, labels)
    assert not is_one_object(rays, np.full(200, 2, np.uint8))
    assert not is_one_object(rays, np.zeros(200, np.uint8))
