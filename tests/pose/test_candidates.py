"""Motions that the search alone misses: with less noise, or of the few matches that it rejects."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from pose_kit import estimate, point_scene, rotation_error

from farpoint import Camera, PoseStatus, RelativePose, estimate_relative_pose
from farpoint.pose import candidates, two_views
from farpoint.pose.competing_motions import compare_modes
from farpoint.pose.general_motion import GeneralMotionFit, fit_general_motion
from farpoint.pose.matches import Matches, matches_from_points
from farpoint.pose.options import DEFAULTS
from farpoint.pose.pure_rotation import fit_pure_rotation
from farpoint.synthetic import PointScene

# What is far ahead on a road: much that is wrong is about as near to where it should be as the
# flow is long.
AHEAD = Camera.pinhole(800, 120, 718.0, 718.0, 400.0, 60.0)
UP = np.array([0.0, 1.0, 0.0])
TOLERANCE = 1.5


class Road(NamedTuple):
    points0: np.ndarray
    points1: np.ndarray
    R: np.ndarray


def road(seed: int) -> Road:
    """45 matches, 25 to 120 m away, of a camera that drove 9 m; half of them off by 15 px."""
    scene = point_scene(
        seed,
        camera=AHEAD,
        matches=45,
        outliers=0,
        far_share=0.0,
        near_range_m=(25.0, 120.0),
        rotation_vector_rad=(0.002, 0.006, -0.001),
        translation_m=(0.1, -0.05, -9.0),
        noise_px=0.4,
    )
    rng = np.random.default_rng(seed + 1000)
    wrong = rng.permutation(45)[:22]
    points1 = scene.points1.copy()
    points1[wrong] += rng.normal(0.0, 15.0, (22, 2))
    return Road(scene.points0, points1, scene.rotation_cam1_from_cam0)


class Lost(NamedTuple):
    rotations: int
    of_them_sure: int


def lost(seeds: range) -> Lost:
    """How many rotations are a degree off or missing; and how many of these with a direction."""
    rotations = sure = 0
    for seed in seeds:
        scene = road(seed)
        pose = estimate_relative_pose(scene.points0, scene.points1, AHEAD)
        if pose.status is not PoseStatus.FAILED:
            off = np.degrees(np.linalg.norm(rotation_error(pose, scene.R)))
            if off < 1.0:
                continue
        rotations += 1
        sure += pose.status is PoseStatus.OK
    return Lost(rotations, sure)


@pytest.fixture(scope="module")
def lost_with_candidates() -> Lost:
    return lost(range(300))


def test_fewer_motions_are_lost(lost_with_candidates, monkeypatch):
    monkeypatch.setattr(two_views, "likeliest_motion", lambda _matches, fit, *_: fit)
    alone = lost(range(300))
    assert alone.rotations > 70
    assert lost_with_candidates.rotations < 0.7 * alone.rotations
    assert lost_with_candidates.of_them_sure < 0.7 * alone.of_them_sure


def test_hardly_any_is_lost_and_sure(lost_with_candidates):
    assert lost_with_candidates.of_them_sure <= 9


@pytest.fixture(scope="module")
def matches() -> Matches:
    drawn = point_scene(3)
    return matches_from_points(drawn.points0, drawn.points1, drawn.camera, drawn.camera)


@pytest.fixture(scope="module")
def fit(matches) -> GeneralMotionFit:
    """The motion, as if with much noise."""
    found = fit_general_motion(matches, TOLERANCE, DEFAULTS, np.array([1], np.uint64))
    return replace(found, noise=found.noise._replace(variance=1.0))


def asked(matches: Matches, fit: GeneralMotionFit) -> GeneralMotionFit:
    state = np.array([1], np.uint64)
    return candidates.likeliest_motion(matches, fit, TOLERANCE, DEFAULTS, state)


@pytest.fixture
def other(fit, monkeypatch):
    """What is found elsewhere is by so much likelier."""

    def by(gain: float, **but: object) -> None:
        quiet = replace(fit.at(fit.R_cam1_from_cam0, UP), **but)
        monkeypatch.setattr(candidates, "fit_with_bounded_noise", lambda *_: quiet)
        cost = fit.cost - gain / len(fit.matches)
        monkeypatch.setattr(
            candidates, "refit_general_motion", lambda _, start: replace(start, cost=cost)
        )

    return by


def test_what_is_clearly_likelier_is_taken(matches, fit, other):
    other(8.5)
    found = asked(matches, fit)
    np.testing.assert_array_equal(found.direction_cam1_from_cam0, UP)
    assert found.candidate_mode is None


@pytest.mark.parametrize(("gain", "against"), [(7.5, 0.0), (-3.0, 3.0)])
def test_what_is_not_is_remembered(matches, fit, other, gain, against):
    other(gain)
    found = asked(matches, fit)
    np.testing.assert_array_equal(found.direction_cam1_from_cam0, fit.direction_cam1_from_cam0)
    assert found.candidate_mode is not None
    _, t, by = found.candidate_mode
    np.testing.assert_array_equal(t, UP)
    assert by == pytest.approx(against)


@pytest.mark.parametrize(("gain", "is_taken"), [(15.0, False), (17.0, True)])
def test_of_a_flow_that_is_mostly_noise_more_is_asked(matches, fit, other, gain, is_taken):
    other(gain, has_shrunk_flow=True)
    assert (asked(matches, fit).candidate_mode is None) == is_taken


def test_the_less_is_known_of_noise_the_clearer_it_must_be(matches, fit, other):
    other(20.0)
    unsure = replace(matches, misspecification=4.0)
    found = asked(unsure, replace(fit, matches=unsure))
    assert found.candidate_mode is not None


def test_a_secondary_mode_is_compared(matches, fit, monkeypatch):
    start = replace(fit, secondary_mode=(np.eye(3), UP))
    monkeypatch.setattr(candidates, "fit_with_bounded_noise", lambda *_: fit)

    def refit(_, start: GeneralMotionFit) -> GeneralMotionFit:
        gain = 9.0 if start.direction_cam1_from_cam0 is UP else 0.0
        return replace(start, cost=fit.cost - gain / len(fit.matches))

    monkeypatch.setattr(candidates, "refit_general_motion", refit)
    np.testing.assert_array_equal(asked(matches, start).direction_cam1_from_cam0, UP)


def test_where_there_is_little_noise_none_is_looked_for(matches, fit, monkeypatch):
    monkeypatch.delattr(candidates, "fit_with_bounded_noise")
    little = replace(fit, noise=fit.noise._replace(variance=0.35))
    assert asked(matches, little) is little


@pytest.mark.parametrize(("against", "is_rival"), [(0.0, True), (6.5, True), (7.5, False)])
def test_a_candidate_that_is_not_clearly_less_likely_competes(fit, against, is_rival):
    candidate_mode = replace(fit, candidate_mode=(fit.R_cam1_from_cam0, UP, against))
    held = compare_modes(candidate_mode, None, lambda: pure_rotation_of(fit), 1e-3)
    assert held.fit is candidate_mode
    assert (held.secondary_mode is not None) == is_rival


def test_correlated_residuals_keep_another_mode(fit):
    """A log-likelihood ratio of 20 is one of 5, if the variance of a sum is four times as large."""
    mode = replace(fit, candidate_mode=(fit.R_cam1_from_cam0, UP, 20.0))
    assert compare_modes(mode, None, lambda: pure_rotation_of(fit), 1e-3).secondary_mode is None
    correlated = mode.matches.with_design_effect(4.0, is_misspecified=False)
    mode = replace(mode, matches=correlated)
    assert compare_modes(mode, None, lambda: pure_rotation_of(fit), 1e-3).secondary_mode is not None


def test_the_same_motion_with_less_noise_does_not_compete(fit):
    same = fit.R_cam1_from_cam0, fit.direction_cam1_from_cam0, 0.0
    candidate_mode = replace(fit, candidate_mode=same)
    assert (
        compare_modes(candidate_mode, None, lambda: pure_rotation_of(fit), 1e-3).secondary_mode
        is None
    )


def pure_rotation_of(fit: GeneralMotionFit):
    return fit_pure_rotation(fit.matches, fit.far_rotation_cam1_from_cam0, TOLERANCE)


LOST = (20, 49, 64, 80, 97, 146, 160, 178, 240, 267, 268, 279)
DOUBTED = (7, 18, 162, 193, 197)


def mostly_far(seed: int, matches: int = 110) -> PointScene:
    """Nine tenths of the right matches at 25 to 35 m; 20 cm to the side, 1 px."""
    return point_scene(
        seed,
        matches=matches,
        outliers=matches // 5,
        far_share=0.9,
        noise_px=1.0,
        translation_m=(0.2, 0.0, 0.0),
    )


def nees_of(pose: RelativePose, scene: PointScene) -> float:
    error = rotation_error(pose, scene.rotation_cam1_from_cam0)
    return float(error @ np.linalg.solve(pose.rotation_covariance, error))


@pytest.mark.parametrize("seed", LOST + DOUBTED)
def test_a_few_near_points_show_a_motion_that_all_others_would_take_for_a_turn(seed):
    """As a turn it is 0.4 deg off, 30 times its sigma."""
    scene = mostly_far(seed)
    pose = estimate(scene)
    assert "Pure rotation or" not in pose.reason
    assert nees_of(pose, scene) < 16.0


@pytest.mark.parametrize("seed", LOST[:4])
def test_the_search_alone_overlooks_it(monkeypatch, seed):
    monkeypatch.setattr(two_views, "likeliest_motion", lambda _matches, fit, *_: fit)
    scene = mostly_far(seed)
    pose = estimate(scene)
    assert pose.status is PoseStatus.ROTATION_ONLY
    assert nees_of(pose, scene) > 100.0


def test_with_many_matches_no_candidate_is_lost_by_subsampling():
    for seed in (25, 82, 172):
        scene = mostly_far(seed, matches=5000)
        assert nees_of(estimate(scene), scene) < 16.0


def test_wrong_matches_make_no_motion_of_a_turn():
    for seed in range(150):
        scene = point_scene(seed, outliers=50, translation_m=(0.0, 0.0, 0.0))
        assert estimate(scene).status is PoseStatus.ROTATION_ONLY
