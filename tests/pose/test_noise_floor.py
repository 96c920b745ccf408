"""What all matches are off by, beside what was told of each, is found and counted."""

from __future__ import annotations

import numpy as np
import pytest
from pose_kit import assert_identical, point_scene, pose_error

from farpoint import PoseStatus, RelativePose, estimate_relative_pose
from farpoint.pose import two_views
from farpoint.pose.general_motion import fit_general_motion
from farpoint.pose.matches import matches_from_points
from farpoint.pose.noise_floor import noise_floor
from farpoint.pose.options import DEFAULTS
from farpoint.synthetic import PointScene

MATCHES = 300


def given_and_floor(seed: int, floor: float) -> tuple[PointScene, np.ndarray, tuple]:
    """A scene, noise told with a median of 0.1 px, and points with a floor, over it, beside."""
    scene = point_scene(
        seed, matches=MATCHES, outliers=0, noise_px=0.0, translation_m=(0.2, 0.1, -0.2)
    )
    rng = np.random.default_rng([seed, 1])
    sigma = 0.1 * np.exp(rng.normal(0.0, 0.8, MATCHES))
    told = sigma[:, None, None] ** 2 * np.eye(2)
    more = np.sqrt(sigma**2 + floor * 0.1**2)[:, None]
    noise = more * rng.normal(size=(2, MATCHES, 2))
    return scene, told, (scene.points0 + noise[0], scene.points1 + noise[1])


def estimated(scene: PointScene, told: np.ndarray, points: tuple) -> RelativePose:
    return estimate_relative_pose(*points, scene.camera, covariance0_px2=told, covariance1_px2=told)


@pytest.mark.parametrize("floor", [0.0, 1.0, 10.0])
def test_the_floor_is_found(floor):
    found = []
    for seed in range(20):
        scene, told, points = given_and_floor(seed, floor)
        matches = matches_from_points(*points, scene.camera, scene.camera, told, told)
        state = np.array([seed], np.uint64)
        found.append(noise_floor(matches, fit_general_motion(matches, 1.5, DEFAULTS, state)))
    # The grid's steps are of a factor of two.
    assert 0.4 * floor <= np.median(found) <= 2.5 * floor + 0.1


def test_a_floor_makes_the_estimate_better_and_keeps_it_honest(monkeypatch):
    errors, nees = {"with": [], "without": []}, {"with": [], "without": []}
    for name in errors:
        if name == "without":
            monkeypatch.setattr(two_views, "noise_floor", lambda *_: 0.0)
        for seed in range(60):
            scene, told, points = given_and_floor(seed, 10.0)
            pose = estimated(scene, told, points)
            assert pose.status is PoseStatus.OK
            error = pose_error(pose, scene)
            errors[name].append(error @ error)
            nees[name].append(error @ np.linalg.solve(pose.covariance, error))
    assert np.mean(errors["with"]) < 0.8 * np.mean(errors["without"])
    # Five degrees of freedom; a mean of 60 scatters by 0.4.
    assert 3.6 < np.mean(nees["with"]) < 6.4
    assert np.mean(nees["without"]) > 8.0


def test_noise_in_px_is_that_of_a_typical_match():
    scene, told, points = given_and_floor(3, 3.0)
    pose = estimated(scene, told, points)
    assert pose.noise_px == pytest.approx(0.1 * np.sqrt(1.0 + 3.0), rel=0.2)


def test_without_given_noise_nothing_changes(monkeypatch):
    scene, _, points = given_and_floor(4, 10.0)
    before = estimate_relative_pose(*points, scene.camera)
    monkeypatch.setattr(two_views, "noise_floor", lambda *_: 1.0)
    assert_identical(before, estimate_relative_pose(*points, scene.camera))
