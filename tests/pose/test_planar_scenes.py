"""Walls and floors: nearly everything on a plane, which allows a second motion."""

from __future__ import annotations

import numpy as np
import pytest

from farpoint import Camera, estimate_relative_pose
from farpoint.geometry import so3, sphere

CAMERA = Camera.pinhole(640, 480, 500.0, 500.0, 319.5, 239.5)
NORMAL = np.array([0.45, -0.25, 1.0]) / 4.0
NOISE_PX = 0.2


def wall(seed: int, direction: np.ndarray, off_the_wall: int) -> tuple[np.ndarray, np.ndarray]:
    """Pixels of 100 points seen from two places 12 cm apart, some in front of the wall."""
    rng = np.random.default_rng(seed)
    points0 = rng.uniform((0.0, 0.0), (639.0, 479.0), (100, 2))
    rays = CAMERA.unproject(points0)
    depth = 1.0 / (rays @ NORMAL)
    depth[:off_the_wall] *= rng.uniform(0.5, 0.8, off_the_wall)
    R = so3.exp(np.radians(rng.uniform(-3.0, 3.0, 3)))
    points1 = CAMERA.project(depth[:, None] * rays @ R.T + 0.12 * direction)
    seen = np.isfinite(points1).all(axis=1)
    noise = rng.normal(0.0, NOISE_PX, (2, seen.sum(), 2))
    return points0[seen] + noise[0], points1[seen] + noise[1]


@pytest.mark.parametrize(
    "direction",
    [(1.0, 0.0, 0.0), (-0.8, 0.1, -0.5), (0.8, -0.1, 0.5)],
    ids=["side", "back", "ahead"],
)
def test_a_few_points_before_a_wall_tell_which_of_the_two_motions_it_was(direction):
    direction = sphere.normalize(np.array(direction))
    angles = []
    for seed in range(40):
        pose = estimate_relative_pose(*wall(seed, direction, off_the_wall=3), CAMERA, seed=seed)
        assert pose.direction_cam1_from_cam0 is not None
        angles.append(sphere.angle_between(pose.direction_cam1_from_cam0, direction))
    # The other motion is 40 degrees away and more.
    assert np.mean(np.array(angles) > np.radians(20.0)) < 0.1
