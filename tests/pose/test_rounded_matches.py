"""Matches that were rounded to whole pixels, as detectors of corners give them."""

from __future__ import annotations

import numpy as np
import pytest
from pose_kit import assert_sound, point_scene, pose_error, rotation_error

from farpoint import PoseStatus, estimate_relative_pose
from farpoint.geometry import so3
from farpoint.metrics import chi2_quantile
from farpoint.pose import matches as matches_module


def rounded(seed: int, **options):
    scene = point_scene(seed, matches=400, outliers=40, noise_px=0.2, **options)
    points0, points1 = np.round(scene.points0), np.round(scene.points1)
    pose = estimate_relative_pose(points0, points1, scene.camera)
    assert_sound(pose, 400)
    return scene, pose


@pytest.fixture
def as_if_exact(monkeypatch):
    monkeypatch.setattr(matches_module, "rounding_variance", lambda *_: 0.0)


def inside(turn_rad: float) -> float:
    """Share of the 95 % regions of rotations that hold the truth."""
    squares = []
    for seed in range(60):
        axis = np.random.default_rng(seed).normal(size=3)
        turn = tuple(turn_rad * axis / np.linalg.norm(axis))
        scene, pose = rounded(seed, rotation_vector_rad=turn, translation_m=(0.0, 0.0, -0.002))
        error = rotation_error(pose, scene.rotation_cam1_from_cam0)
        squares.append(float(error @ np.linalg.solve(pose.rotation_covariance, error)))
    return float(np.mean(np.array(squares) <= chi2_quantile(0.95, 3)))


def test_what_moves_by_less_than_a_pixel_is_not_known_to_stand_still():
    assert inside(2e-4) > 0.9


@pytest.mark.usefixtures("as_if_exact")
def test_taken_for_exact_it_is():
    assert inside(2e-4) < 0.7


def test_longer_motions_hold_the_truth():
    squares = []
    for seed in range(40):
        scene, pose = rounded(seed, translation_m=(0.05, 0.02, -0.15))
        assert pose.status is PoseStatus.OK
        assert 0.3 < pose.noise_px < 0.7
        error = pose_error(pose, scene)
        squares.append(float(error @ np.linalg.solve(pose.covariance, error)))
    assert np.mean(np.array(squares) <= chi2_quantile(0.95, 5)) > 0.85


def test_still_pictures_stay_still():
    scene = point_scene(1, matches=200, outliers=0)
    points = np.round(scene.points0)
    pose = estimate_relative_pose(points, points, scene.camera)
    assert pose.status is PoseStatus.STATIC
    assert so3.angle_between(pose.rotation_cam1_from_cam0, np.eye(3)) < 1e-6
    # A hundredth of a pixel is what 200 matches to the pixel tell.
    assert np.sqrt(np.trace(pose.rotation_covariance)) > 0.02 / 727.0
