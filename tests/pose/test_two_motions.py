"""The motion of most matches, where something moves by itself."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from pose_kit import rotation_error, smooth_field

from farpoint import (
    Camera,
    PoseStatus,
    RelativePose,
    RelativePoseOptions,
    estimate_relative_pose,
)
from farpoint.geometry import so3
from farpoint.metrics import chi2_quantile
from farpoint.pose import general_motion, two_motions, two_views
from farpoint.pose.constants import MERGED_MODE_CORRELATION, SEARCH_SAMPLES
from farpoint.pose.covariance import inflation_between_patches
from farpoint.pose.general_motion import GeneralMotionFit
from farpoint.pose.matches import Matches, matches_from_points
from farpoint.pose.options import DEFAULTS
from farpoint.synthetic import PointSceneOptions, make_point_scene

CAMERA = Camera.pinhole(640, 480, 500.0, 500.0, 319.5, 239.5)
NOISE_PX = 0.2


class Traffic(NamedTuple):
    points0: np.ndarray
    points1: np.ndarray
    R: np.ndarray
    moves: np.ndarray


def traffic(seed: int, share: float, shift_px: float, matches: int = 300) -> Traffic:
    """Near and far points, and something that takes this share of the matches, and moves."""
    rng = np.random.default_rng(seed)
    options = PointSceneOptions(
        camera=CAMERA,
        matches=matches,
        outliers=0,
        rotation_vector_rad=(0.02, -0.03, 0.01),
        translation_m=tuple(rng.normal(0.0, 0.1, 3)),
        noise_px=NOISE_PX,
    )
    scene = make_point_scene(options, seed=seed)
    middle, angle = scene.points0[rng.integers(matches)], rng.uniform(0.0, 2.0 * np.pi)
    nearest = np.argsort(np.linalg.norm(scene.points0 - middle, axis=1))
    moves = np.isin(np.arange(matches), nearest[: round(share * matches)])
    points1 = scene.points1 + shift_px * np.outer(moves, [np.cos(angle), np.sin(angle)])
    return Traffic(scene.points0, points1, scene.rotation_cam1_from_cam0, moves)


def correlated(fit: GeneralMotionFit, correlation: float) -> GeneralMotionFit:
    """The fit as if its neighbouring residuals were correlated so much."""
    made = replace(fit)
    made.__dict__["neighbours"] = fit.neighbours._replace(correlation=correlation)
    return made


def off_deg(pose: RelativePose, scene: Traffic) -> float:
    return float(np.degrees(np.linalg.norm(rotation_error(pose, scene.R))))


def fit_of(points0: np.ndarray, points1: np.ndarray) -> tuple[Matches, GeneralMotionFit]:
    matches = matches_from_points(points0, points1, CAMERA, CAMERA)
    return matches, general_motion.fit_general_motion(
        matches, 1.5, DEFAULTS, np.array([1], np.uint64)
    )


def searched_again(*_):
    raise AssertionError("searched again")


def dominant_of(
    matches: Matches, fit: GeneralMotionFit, tolerance: float = 1.5
) -> GeneralMotionFit:
    state = np.array([1], np.uint64)
    return two_motions.dominant_motion(matches, fit, tolerance, DEFAULTS, state)


def far_off(scenes: list[Traffic]) -> int:
    """How many rotations are off by more than a tenth of a degree."""
    poses = [estimate_relative_pose(scene.points0, scene.points1, CAMERA) for scene in scenes]
    return sum(off_deg(*each) > 0.1 for each in zip(poses, scenes, strict=True))


@pytest.mark.parametrize(
    ("share", "shift_px", "most", "between"),
    [(0.2, 3.0, 7, 9), (0.3, 3.0, 11, 25), (0.4, 6.0, 8, 30)],
)
def test_the_camera_moves_as_most_matches_do(monkeypatch, share, shift_px, most, between):
    """Of 40 poses 5, 9 and 5 are off; of the likeliest, between both motions, 10, 29 and 34."""
    scenes = [traffic(seed, share, shift_px) for seed in range(40)]
    assert far_off(scenes) <= most
    monkeypatch.setattr(two_views, "dominant_motion", lambda _matches, fit, *_: fit)
    assert far_off(scenes) >= between


def test_what_moves_is_labelled_and_the_region_holds_the_truth():
    inside, labelled = [], []
    for seed in range(40):
        scene = traffic(seed, 0.3, 6.0)
        matches, fit = fit_of(scene.points0, scene.points1)
        if dominant_of(matches, fit) is fit:
            continue
        pose = estimate_relative_pose(scene.points0, scene.points1, CAMERA)
        assert pose.status is PoseStatus.OK
        turn = rotation_error(pose, scene.R)
        square = float(turn @ np.linalg.solve(pose.rotation_covariance, turn))
        inside.append(square <= chi2_quantile(0.95, 3))
        labelled.append(np.mean((pose.labels == 0) == scene.moves))
    assert len(inside) >= 12
    assert np.mean(inside) > 0.75
    # What moves along its epipolar lines does not show.
    assert np.median(labelled) > 0.85


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_noise_is_not_looked_at_again(monkeypatch, share):
    """With or without wrong matches that have nothing in common."""
    monkeypatch.setattr(two_motions, "fit_with_bounded_noise", searched_again)
    for seed in range(20):
        scene, rng = traffic(seed, 0.0, 0.0), np.random.default_rng(seed)
        wrong = rng.uniform(size=len(scene.points1)) < share
        points1 = scene.points1 + wrong[:, None] * rng.normal(0.0, 60.0, scene.points1.shape)
        matches, fit = fit_of(scene.points0, points1)
        assert dominant_of(matches, fit) is fit


def test_smooth_errors_lead_to_no_other_motion():
    """Such as those of a lens: with less noise they are as smooth, and all matches are heard."""
    were_smooth = 0
    for seed in range(30):
        scene = traffic(seed, 0.0, 0.0)
        points1 = scene.points1 + smooth_field(seed, scene.points1, 1.0, 60.0)
        matches, fit = fit_of(scene.points0, points1)
        were_smooth += fit.neighbours.correlation > MERGED_MODE_CORRELATION
        assert dominant_of(matches, fit) is fit
    assert were_smooth >= 20


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_wrong_matches_do_not_make_smooth_errors_look_apart(share):
    """They lie anywhere, and no tail of those that agree."""
    were_smooth = 0
    for seed in range(30):
        scene, rng = traffic(seed, 0.0, 0.0), np.random.default_rng(seed)
        points1 = scene.points1 + smooth_field(seed, scene.points1, 0.5, 60.0)
        wrong = rng.uniform(size=len(points1)) < share
        points1[wrong] = rng.uniform((0.0, 0.0), CAMERA.size, (np.count_nonzero(wrong), 2))
        matches, fit = fit_of(scene.points0, points1)
        were_smooth += fit.neighbours.correlation > MERGED_MODE_CORRELATION
        assert dominant_of(matches, fit) is fit
    assert were_smooth >= 10


@pytest.mark.parametrize(("wrong_px", "least"), [(None, 10), (20.0, 5), (30.0, 10)])
def test_wrong_matches_of_a_wide_image_are_no_other_motion(wrong_px, least):
    """Ahead through a wide image, with errors that neighbours share; a quarter is wrong.

    Anywhere, or by so many px where it should be.
    """
    camera = Camera.pinhole(1226, 160, 707.0, 707.0, 612.5, 79.5)
    options = PointSceneOptions(
        camera=camera,
        matches=500,
        outliers=125 if wrong_px is None else 0,
        near_range_m=(6.0, 40.0),
        far_share=0.0,
        translation_m=(0.02, 0.0, -0.9),
        noise_px=0.05,
    )
    were_alike = 0
    for seed in range(12):
        scene, rng = make_point_scene(options, seed=seed), np.random.default_rng(seed)
        points1 = scene.points1 + smooth_field(seed, scene.points1, 0.2)
        if wrong_px is not None:
            points1[:125] += rng.normal(0.0, wrong_px, (125, 2))
        matches = matches_from_points(scene.points0, points1, camera, camera)
        state = np.array([1], np.uint64)
        fit = general_motion.fit_general_motion(matches, 1.5, DEFAULTS, state)
        were_alike += fit.neighbours.correlation > MERGED_MODE_CORRELATION
        assert dominant_of(matches, fit) is fit
    assert were_alike >= least


def test_what_neighbours_share_of_a_small_noise_is_not_looked_at_again(monkeypatch):
    monkeypatch.setattr(two_motions, "fit_with_bounded_noise", searched_again)
    matches, fit = fit_of(*traffic(1, 0.0, 0.0)[:2])
    small = correlated(replace(fit, noise=fit.noise._replace(variance=0.14**2)), 0.9)
    assert dominant_of(matches, small) is small
    # A tolerance of less says that less is wrong.
    with pytest.raises(AssertionError, match="searched again"):
        dominant_of(matches, small, tolerance=1.0)


def test_a_motion_of_few_is_not_that_of_most(monkeypatch):
    matches, fit = fit_of(*traffic(2, 0.4, 6.0)[:2])
    assert dominant_of(matches, fit) is not fit

    def of_few(*arguments):
        return replace(general_motion.refit_general_motion(*arguments), agreeing=fit.agreeing // 3)

    monkeypatch.setattr(two_motions, "refit_general_motion", of_few)
    assert dominant_of(matches, fit) is fit


def test_the_dominant_motion_inflates_by_the_correlation_of_the_likelier_one():
    scene = traffic(2, 0.4, 6.0)
    matches, fit = fit_of(*scene[:2])
    found = dominant_of(matches, fit)
    assert (fit.merged_mode_correlation, found.merged_mode_correlation) == (
        0.0,
        fit.neighbours.correlation,
    )
    assert fit.neighbours.correlation > MERGED_MODE_CORRELATION > found.neighbours.correlation
    assert inflation_between_patches(found) == 1.0 + 4.0 * (fit.neighbours.correlation - 0.25)
    pose = estimate_relative_pose(scene.points0, scene.points1, CAMERA)
    assert "moving objects" in pose.reason


def test_neighbours_may_be_off_by_more_than_each_match():
    """The correlation is no more than one on average only."""
    matches, fit = fit_of(*traffic(2, 0.4, 6.0)[:2])
    found = dominant_of(matches, correlated(fit, 1.1))
    assert np.isfinite(found.covariance).all()


def test_many_samples_may_be_asked_for():
    scene = traffic(2, 0.4, 6.0)
    options = RelativePoseOptions(min_iterations=SEARCH_SAMPLES + 200)
    pose = estimate_relative_pose(scene.points0, scene.points1, CAMERA, options=options)
    assert pose.status is PoseStatus.OK


def test_a_likelier_motion_that_the_first_search_missed_is_taken():
    """All agree on it, so that nothing lies apart."""
    for seed in range(10):
        scene = traffic(seed, 0.0, 0.0)
        matches, fit = fit_of(scene.points0, scene.points1)
        missed = replace(
            fit,
            R_cam1_from_cam0=so3.exp(np.array([0.02, 0.0, 0.0])) @ fit.R_cam1_from_cam0,
            noise=fit.noise._replace(variance=16.0 * fit.noise.variance),
            cost=fit.cost + 1.0,
        )
        missed = correlated(missed, 0.7)
        found = dominant_of(matches, missed)
        assert found is not missed
        assert so3.angle_between(found.R_cam1_from_cam0, fit.R_cam1_from_cam0) < 1e-4
        # One that is as likely stays.
        alike = correlated(fit, 0.7)
        assert dominant_of(matches, alike) is alike


def test_no_more_noise_is_believed_than_each_match_has_of_its_own():
    sigmas = []
    for seed in range(20):
        matches, fit = fit_of(*traffic(seed, 0.4, 6.0)[:2])
        found = dominant_of(matches, fit)
        if found is not fit:
            assert found.noise.sigma < fit.noise.sigma
            assert found.noise.tail_share < 1e-6
            sigmas.append(found.noise.sigma)
    assert len(sigmas) >= 10
    assert np.median(sigmas) == pytest.approx(NOISE_PX, rel=0.25)


def test_two_of_each_point_are_not_two_motions():
    """A point that was found twice shares all of its noise with itself."""
    scene = traffic(1, 0.0, 0.0, 150)
    points0, points1 = np.repeat(scene.points0, 2, axis=0), np.repeat(scene.points1, 2, axis=0)
    matches, fit = fit_of(points0, points1)
    assert fit.neighbours.correlation > 0.99
    assert dominant_of(matches, fit) is fit


def test_correlated_residuals_of_neighbours_are_reported(monkeypatch):
    monkeypatch.setattr(two_views, "dominant_motion", lambda _matches, fit, *_: fit)
    scene = traffic(2, 0.4, 6.0)
    pose = estimate_relative_pose(scene.points0, scene.points1, CAMERA)
    assert fit_of(scene.points0, scene.points1)[1].neighbours.correlation > MERGED_MODE_CORRELATION
    assert "Residuals of neighbouring matches are correlated" in pose.reason
