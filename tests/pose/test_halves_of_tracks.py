"""Covariances that are corrected by what halves of the matches show of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pose_kit import estimate, point_scene

from farpoint import PoseStatus, RelativePose, RelativePoseOptions, estimate_relative_pose
from farpoint.pose.inflation import split_half_ratio_of_rotation
from farpoint.pose.matches import matches_from_points
from farpoint.pose.pure_rotation import fit_pure_rotation
from farpoint.synthetic import PointScene

OPTIONS = RelativePoseOptions(half_splits=8)


def scene(seed: int, matches: int = 200) -> PointScene:
    options = {"outliers": matches // 20, "noise_px": 0.2, "far_share": 0.3}
    return point_scene(seed, matches=matches, translation_m=(0.1, 0.0, 0.2), **options)


@pytest.fixture(scope="module")
def growths() -> np.ndarray:
    """How much larger (80,) the covariance is than computed where the noise is white."""
    found = []
    for seed in range(80):
        computed, corrected = estimate(scene(seed)), estimate(scene(seed), options=OPTIONS)
        assert computed.status is corrected.status is PoseStatus.OK
        np.testing.assert_array_equal(
            computed.rotation_cam1_from_cam0, corrected.rotation_cam1_from_cam0
        )
        ratio = corrected.covariance / computed.covariance
        np.testing.assert_allclose(ratio, ratio[0, 0], rtol=1e-9)  # in every axis alike
        found.append(ratio[0, 0])
    return np.array(found)


def test_halves_of_white_noise_show_what_was_computed(growths):
    # 0.975: each has 40 degrees of freedom of 80, and scatters by 0.14; their mean by 0.016.
    assert 0.93 < growths.mean() < 1.02
    assert 0.06 < growths.std() < 0.2


def on_surfaces(width_px: float, *, is_told: bool = True) -> list[RelativePose]:
    """Twelve motions where all points of a square err alike, by thrice their noise."""
    found = []
    for seed in range(12):
        view, rng = scene(seed, 400), np.random.default_rng(seed)
        shared = rng.normal(0.0, 0.6, (60, 60, 2))
        column, row = (view.points0 // width_px).astype(int).T
        points1 = view.points1 + shared[column, row]
        noise = np.tile(0.02 * np.eye(2), (len(points1), 1, 1))
        told = {"covariance0_px2": noise, "covariance1_px2": noise} if is_told else {}
        pose = estimate_relative_pose(view.points0, points1, view.camera, **told, options=OPTIONS)
        assert pose.status is PoseStatus.OK
        found.append(pose)
    return found


def mean_ratio(poses: list[RelativePose]) -> float:
    return float(np.mean([pose.stats.half_ratio for pose in poses]))


def test_surfaces_with_common_errors_are_seen_by_halves():
    # 7.8, 2.7 and 1.3 of squares with some fifty tracks, ten and one. By patches of three to six
    # tracks instead of 16 parts it was 1.9, 1.7 and 1.15.
    assert 5.0 < mean_ratio(on_surfaces(220.0)) < 11.0
    assert 2.0 < mean_ratio(on_surfaces(60.0)) < 3.5
    assert 1.0 < mean_ratio(on_surfaces(20.0)) < 1.6


def test_what_a_design_effect_counts_is_not_counted_again():
    """The design effect scales the information, and halves are held to what it leaves."""
    told, untold = on_surfaces(220.0), on_surfaces(220.0, is_told=False)
    assert all(pose.stats.sharing == 1.0 for pose in told)
    assert all(pose.stats.sharing > 2.0 for pose in untold)
    common = replace(OPTIONS, common_error_slope=10.0)
    view = scene(0, 400)
    column, row = (view.points0 // 220.0).astype(int).T
    points1 = view.points1 + np.random.default_rng(0).normal(0.0, 0.6, (60, 60, 2))[column, row]
    plain, doubting = (
        estimate_relative_pose(view.points0, points1, view.camera, options=each)
        for each in (OPTIONS, common)
    )
    assert plain.stats.residual_correlation > 0.3
    np.testing.assert_array_equal(plain.covariance, doubting.covariance)


@pytest.mark.parametrize(("matches", "has_halves"), [(59, False), (60, True)])
def test_few_matches_have_no_halves(matches, has_halves):
    few = scene(3, matches)
    computed, corrected = estimate(few), estimate(few, options=OPTIONS)
    assert computed.status is corrected.status is PoseStatus.OK
    assert (corrected.stats.half_ratio is not None) == has_halves
    assert np.array_equal(corrected.covariance, computed.covariance) != has_halves


def test_the_fewest_that_have_halves_show_about_what_was_computed():
    options = RelativePoseOptions(half_splits=16)
    shown = [estimate(scene(seed, 60), options=options).stats.half_ratio for seed in range(60)]
    # 0.88, and 0.7 of 32 matches: halves are expected to know their noise less well than they do.
    # The mean scatters by 0.03.
    assert 0.83 < np.mean(shown) < 1.03


def turn(seed: int, matches: int = 200) -> PointScene:
    options = {"outliers": matches // 20, "noise_px": 0.2, "far_share": 0.3}
    return point_scene(seed, matches=matches, translation_m=(0.0, 0.0, 0.0), **options)


def test_halves_of_a_turn_show_what_was_computed():
    plain = RelativePoseOptions(shared_error_px=0.0)
    options = replace(plain, half_splits=16)
    shown, grown = [], []
    for seed in range(100):
        computed, corrected = (estimate(turn(seed), options=each) for each in (plain, options))
        assert corrected.status is PoseStatus.ROTATION_ONLY
        shown.append(corrected.stats.half_ratio)
        # 48 degrees of freedom in 16 deals, beside the 40 of what was expected.
        growth = (40.0 + 48.0 * shown[-1]) / 88.0
        expected = growth * computed.rotation_covariance
        grown.append(np.allclose(corrected.rotation_covariance, expected, rtol=1e-9, atol=0.0))
    # Their mean scatters by 0.025.
    assert 0.93 < np.mean(shown) < 1.07
    # Of the others a motion is in doubt, which is not of the noise.
    assert np.mean(grown) > 0.8
    assert estimate(turn(3, 59), options=options).stats.half_ratio is None


def half_ratio_at(*places: tuple[float, float, int]) -> float | None:
    """Of so many matches at each place, in px, of a camera that stands still."""
    camera, rng = turn(0).camera, np.random.default_rng(1)
    points = np.concatenate([np.tile([x, y], (count, 1)) for x, y, count in places])
    shaken = points + rng.normal(0.0, 0.2, points.shape)
    matches = matches_from_points(points, shaken, camera, camera)
    return split_half_ratio_of_rotation(matches, fit_pure_rotation(matches, np.eye(3), 1.5), 8)


def test_halves_that_fix_no_turn_are_left_out():
    spread = [(100.0 * x, 100.0 * y, 4) for x in range(1, 6) for y in range(1, 5)]
    assert 0.1 < half_ratio_at(*spread) < 5.0
    # One patch, a second one that is too small for a half, and halves at one place each.
    assert half_ratio_at((320.0, 240.0, 100)) == 1.0
    assert half_ratio_at((100.0, 50.0, 95), (500.0, 400.0, 5)) == 1.0
    assert half_ratio_at((100.0, 50.0, 50), (500.0, 400.0, 50)) == 1.0


@pytest.mark.parametrize("drawn", [scene, turn])
def test_neighbours_with_common_errors_stay_in_one_half(drawn):
    shown = []
    for seed in range(12):
        view = drawn(seed, 60)
        # Five of each, side by side: they tell as much as one does.
        rng = np.random.default_rng(seed)
        step = rng.normal(0.0, 2.0, (300, 2))
        pixels = [np.repeat(points, 5, axis=0) + step for points in (view.points0, view.points1)]
        pose = estimate_relative_pose(*pixels, view.camera, options=OPTIONS)
        shown.append(pose.stats.half_ratio)
    # 4.9 (of turns 6.8) by 16 parts; 1.05 if each is dealt by itself.
    assert 2.5 < np.median(shown) < 9.0
