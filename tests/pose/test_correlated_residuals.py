"""Matches that err as their neighbours do: what a tracker shares is not counted as noise."""

from __future__ import annotations

import numpy as np
import pytest
from pose_kit import assert_sound, direction_error, rotation_error

from farpoint import (
    Camera,
    PoseStatus,
    RelativePose,
    RelativePoseOptions,
    estimate_relative_pose,
)
from farpoint.bench.plain_script import PlainScript
from farpoint.geometry import sphere
from farpoint.metrics import chi2_quantile
from farpoint.pose import correlated_residuals, two_views
from farpoint.synthetic import PointScene, RenderedSequence, make_point_scene, street_drive
from farpoint.synthetic.pairs import smooth_field
from farpoint.synthetic.points import PointSceneOptions

CAMERA = Camera.pinhole(640, 480, 500.0, 500.0, 319.5, 239.5)
NOISE_PX = 0.15


def scene(seed: int, baseline_m: float, matches: int = 300) -> PointScene:
    direction = sphere.normalize(np.random.default_rng(seed).normal(size=3))
    options = PointSceneOptions(
        camera=CAMERA,
        matches=matches,
        outliers=matches // 20,
        rotation_vector_rad=(0.02, 0.05, -0.03),
        translation_m=tuple(baseline_m * direction),
        noise_px=NOISE_PX,
    )
    return make_point_scene(options, seed=seed)


def estimate(found: PointScene, seed: int, share: float = 1.0) -> RelativePose:
    points1 = found.points1 + share * smooth_field(seed, found.points1)
    pose = estimate_relative_pose(found.points0, points1, CAMERA)
    assert_sound(pose, len(points1))
    return pose


@pytest.fixture
def misspecified_noise() -> list[bool]:
    """Whether the noise counts as misspecified, for each estimate since."""
    return []


@pytest.fixture
def shared(monkeypatch, misspecified_noise) -> list[float]:
    """How many times larger each covariance since is made; 1 for noise of each match's own."""
    found: list[float] = []

    def doubted(matches, fit):
        matches, fit = correlated_residuals.count_residual_correlation(matches, fit)
        assert (fit.matches.design_effect, fit.matches.misspecification) == (
            matches.design_effect,
            matches.misspecification,
        )
        found.append(matches.design_effect)
        misspecified_noise.append(matches.misspecification > 1.0)
        return matches, fit

    monkeypatch.setattr(two_views, "count_residual_correlation", doubted)
    return found


@pytest.mark.parametrize("matches", [60, 300])
def test_noise_of_each_match_is_hardly_ever_shared_or_doubted(shared, misspecified_noise, matches):
    for seed in range(150):
        estimate(scene(seed, 0.1, matches), seed, share=0.0)
    assert np.count_nonzero(np.array(shared) > 1.0) <= 4
    assert np.count_nonzero(misspecified_noise) <= 2


def test_a_turn_with_errors_that_neighbours_share_is_no_motion(shared, misspecified_noise):
    poses = [estimate(scene(seed, 0.0), seed) for seed in range(60)]
    moving = sum(pose.status is PoseStatus.OK for pose in poses)
    # Counted as independent, twenty of them claim a direction.
    assert moving <= 4
    assert np.mean(np.array(shared) > 1.5) > 0.9
    assert np.mean(misspecified_noise) > 0.9


def test_rotations_of_turns_hold_the_truth_more_often():
    """Counted as independent 0.45 are within their 95 %, and 0.27 without the design effect."""
    inside = []
    for seed in range(100):
        found = scene(seed, 0.0)
        pose = estimate(found, seed)
        turn = rotation_error(pose, found.rotation_cam1_from_cam0)
        square = float(turn @ np.linalg.solve(pose.rotation_covariance, turn))
        inside.append(square <= chi2_quantile(0.95, 3))
    assert np.mean(inside) > 0.7


def test_a_plain_motion_stays_one(shared):
    poses = [estimate(scene(seed, 0.1), seed) for seed in range(30)]
    assert {pose.status for pose in poses} == {PoseStatus.OK}
    assert [pose.stats.sharing for pose in poses] == shared
    assert np.mean(shared) > 2.0


def test_errors_may_be_taken_for_independent():
    found = scene(1, 0.1)
    points1 = found.points1 + smooth_field(1, found.points1)
    plain, counted = (
        estimate_relative_pose(
            found.points0, points1, CAMERA, options=RelativePoseOptions(count_sharing=counted)
        )
        for counted in (False, True)
    )
    np.testing.assert_array_equal(plain.rotation_cam1_from_cam0, counted.rotation_cam1_from_cam0)
    assert (plain.stats.sharing, counted.stats.sharing > 1.5) == (1.0, True)
    np.testing.assert_allclose(counted.covariance, counted.stats.sharing * plain.covariance)


@pytest.mark.usefixtures("shared")
@pytest.mark.parametrize("apart_px", [0.0, 0.5])
def test_a_point_that_is_found_twice_tells_what_it_tells_once(misspecified_noise, apart_px):
    squares = []
    for seed in range(60):
        found, rng = scene(seed, 0.1, 150), np.random.default_rng(seed)
        points0, points1 = found.points0.copy(), found.points1.copy()
        # A detector of features that finds half of the points again, and errs alike.
        aside = rng.uniform(-apart_px, apart_px, (75, 2))
        points0, points1 = (
            np.r_[points0, points0[::2] + aside],
            np.r_[points1, points1[::2] + aside],
        )
        pose = estimate_relative_pose(points0, points1, CAMERA)
        turn = rotation_error(pose, found.rotation_cam1_from_cam0)
        squares.append(float(turn @ np.linalg.solve(pose.rotation_covariance, turn)))
    assert np.mean(misspecified_noise) > 0.9
    # Counted as independent, 0.75 and 0.77.
    assert np.mean(np.array(squares) <= chi2_quantile(0.95, 3)) > 0.9


def test_few_right_matches_show_nothing_of_their_neighbours(shared):
    estimate(scene(1, 0.1, 49), 1)
    found = scene(1, 0.1, 90)
    points1 = found.points1 + smooth_field(1, found.points1)
    points1[:45] = np.roll(points1[:45], 1, axis=0)
    estimate_relative_pose(found.points0, points1, CAMERA)
    assert shared == [1.0, 1.0]


def squares(seed: int, fps: float, most: int) -> list[float]:
    """Normalised squares of the errors along a rendered street, against its exact truth."""
    sequence = RenderedSequence(CAMERA, street_drive(6, fps, seed), seed=seed)
    images, script = [frame.image for frame in sequence], PlainScript(CAMERA, most)
    found = []
    for k in range(5):
        points = script.match(images[k], images[k + 1])
        pose = estimate_relative_pose(*points, CAMERA)
        assert pose.status is PoseStatus.OK
        cam1_from_cam0 = sequence.cam1_from_cam0(k, k + 1)
        turn = rotation_error(pose, cam1_from_cam0[:3, :3])
        aside = direction_error(pose, sphere.normalize(cam1_from_cam0[:3, 3]))
        error = np.concatenate([turn, aside])
        found.append(float(error @ np.linalg.solve(pose.covariance, error)))
    return found


def test_the_covariance_of_what_opencv_tracks_holds_the_truth():
    """Counted as independent, these matches have 95 % regions that hold 0.2 of the truths."""
    found = np.concatenate([squares(seed, 20.0, 400) for seed in range(300, 307)])
    assert np.mean(found <= chi2_quantile(0.95, 5)) > 0.75
    assert 0.3 < np.mean(found) / 5.0 < 2.0
