"""What stands still in the image goes along with the camera."""

from __future__ import annotations

import numpy as np
import pytest
from pose_kit import estimate, point_scene, rotation_error

from farpoint import Camera, PoseStatus, estimate_relative_pose
from farpoint.bench.scenes import draw_scenes
from farpoint.geometry import so3
from farpoint.synthetic.pairs import HardPair, stationary


def drawn(count: int, share: float, noise_px: float = 0.22, **grid) -> list[HardPair]:
    rng = np.random.default_rng([11, round(100 * share)])
    scenes = draw_scenes(count, rng, matches=300, outliers=15, noise_px=noise_px, **grid)
    return [
        stationary(scene, seed, share=share, noise_px=noise_px) for seed, scene in enumerate(scenes)
    ]


def errors_deg(scenes: list[HardPair]) -> np.ndarray:
    """Rotation errors, from the largest on."""
    errors = [
        np.linalg.norm(rotation_error(estimate(s), s.rotation_cam1_from_cam0)) for s in scenes
    ]
    return np.degrees(np.sort(errors))[::-1]


@pytest.mark.parametrize("noise_px", [0.22, 0.7])
@pytest.mark.parametrize("far_share", [0.0, 0.5])
def test_two_fifths_that_go_along_with_the_camera_do_not_hold_it(far_share, noise_px):
    """Taken for points of the scene, they hold half of these cameras still: up to 7 deg off.

    Of 1600 such scenes, 5 are.
    """
    scenes = drawn(20, 0.4, noise_px, baseline_m=0.1, far_share=far_share)
    assert errors_deg(scenes)[1] < 2.0 * noise_px
    pose = estimate(scenes[0])
    is_stuck = scenes[0].is_outlier
    assert np.mean(pose.labels[is_stuck] == 0) > 0.95
    assert np.mean(pose.labels[~is_stuck] > 0) > 0.8
    assert "matches stand still in the image" in pose.reason


def test_a_rotating_camera_is_not_taken_for_stationary():
    for scene in drawn(10, 0.4, baseline_m=0.0, far_share=0.5):
        pose = estimate(scene)
        assert pose.status is PoseStatus.ROTATION_ONLY
        error = np.linalg.norm(rotation_error(pose, scene.rotation_cam1_from_cam0))
        assert np.degrees(error) < 0.15


def looking_ahead(far: int, seed: int, noise_px: float = 0.2) -> tuple[np.ndarray, np.ndarray]:
    """Matches of a camera that goes ahead and does not turn, so many of them far."""
    rng = np.random.default_rng(seed)
    points0 = rng.uniform([0.0, 0.0], [640.0, 480.0], (300, 2))
    depth_m = np.where(np.arange(300) < far, 1e4, rng.uniform(4.0, 12.0, 300))[:, None]
    middle = np.array([319.5, 239.5])
    points1 = middle + (points0 - middle) * depth_m / (depth_m - 1.0)
    return points0, points1 + rng.normal(0.0, noise_px, (300, 2))


CAMERA = Camera.pinhole(640, 480, 500.0, 500.0, 319.5, 239.5)


@pytest.mark.parametrize("far", [40, 140])
def test_what_is_far_stands_still_by_right(far):
    for seed in range(10):
        pose = estimate_relative_pose(*looking_ahead(far, seed), CAMERA)
        assert pose.status is PoseStatus.OK
        assert "stand still" not in pose.reason
        assert pose.stats.far >= 0.9 * far


def test_a_camera_that_stands_still_among_what_moves_stands_still():
    """Fewer go together than stand still."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        points0 = rng.uniform([0.0, 0.0], [640.0, 480.0], (300, 2))
        points1 = points0 + rng.normal(0.0, 0.2, (300, 2))
        aside = points0[:120] - [319.5, 239.5]
        points1[:120] += 0.05 * aside[:, ::-1] * [-1.0, 1.0]  # a roll, which no translation is
        points1[120:160] = rng.uniform([0.0, 0.0], [640.0, 480.0], (40, 2))
        pose = estimate_relative_pose(points0, points1, CAMERA)
        assert "Stationary matches" not in pose.reason


@pytest.mark.parametrize(("share", "is_noted"), [(0.03, False), (0.55, False), (0.3, True)])
def test_few_matches_are_outliers_and_most_are_the_scene(share, is_noted):
    noted = ["Stationary" in estimate(scene).reason for scene in near(10, share)]
    assert np.mean(noted) == is_noted


def near(count: int, share: float) -> list[HardPair]:
    return drawn(count, share, baseline_m=0.1, far_share=0.0)


def test_a_window_frame_around_the_scene_moves_with_the_camera():
    """Stationary matches around the scene have the larger scatter, and are not the scene."""
    for seed in range(15):
        scene = point_scene(seed, matches=400, outliers=0, noise_px=0.2)
        middle = np.array(scene.camera.size) / 2.0
        apart = np.abs(scene.points0 / middle - 1.0).max(axis=1)
        points1, frame = scene.points1.copy(), np.argsort(apart)[-160:]
        points1[frame] = scene.points0[frame]
        points1 += np.random.default_rng(seed).normal(0.0, 0.2, points1.shape)
        pose = estimate_relative_pose(scene.points0, points1, scene.camera)
        assert pose.status is PoseStatus.OK
        assert so3.angle_between(pose.rotation_cam1_from_cam0, scene.rotation_cam1_from_cam0) < 5e-3
        assert np.count_nonzero(pose.labels[frame]) < 0.1 * len(frame)
