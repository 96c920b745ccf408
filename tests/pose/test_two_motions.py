"""The motion of the camera, where something moves by itself or with the camera."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pose_kit import estimate, rotation_error
from scipy.integrate import quad

from farpoint import Camera, PoseStatus, RelativePoseOptions
from farpoint.geometry import so3
from farpoint.metrics import chi2_quantile
from farpoint.pose.general_motion import GeneralMotionFit, fit_general_motion, log_densities
from farpoint.pose.matches import Matches, matches_from_points
from farpoint.pose.options import DEFAULTS
from farpoint.pose.two_motions import (
    TwoMotions,
    _classification,
    _log_likelihoods,
    explain_by_two,
)
from farpoint.synthetic import PointSceneOptions, make_point_scene
from farpoint.synthetic.pairs import (
    HardPair,
    court,
    crossing,
    smooth_errors,
    smooth_field,
    traffic,
)

NOISE_PX = 0.2


def fit_of(points0: np.ndarray, points1: np.ndarray, camera: Camera) -> GeneralMotionFit:
    matches = matches_from_points(points0, points1, camera, camera)
    return fit_general_motion(matches, 1.5, DEFAULTS, np.array([1], np.uint64))


def explained(fit: GeneralMotionFit) -> TwoMotions | None:
    return explain_by_two(fit.matches, fit, 1.5, DEFAULTS, np.array([1], np.uint64))


def found_in(scene: HardPair) -> tuple[GeneralMotionFit, TwoMotions | None]:
    fit = fit_of(scene.points0, scene.points1, scene.camera)
    return fit, explained(fit)


def off_deg(R: np.ndarray, scene: HardPair) -> float:
    return float(np.degrees(so3.angle_between(R, scene.rotation_cam1_from_cam0)))


def test_a_lorry_with_many_matches_is_not_the_scene():
    """A compact object with 40 % of the matches, which one motion explains together with the scene.

    13 of 80 directions are more than 10 deg off if the motion with more matches is the camera's.
    """
    wrong = 0
    for seed in range(80):
        scene = crossing(seed, share=0.4, at_rest=False)
        found = estimate(scene).direction_cam1_from_cam0
        if found is not None:
            true = scene.translation_cam1_from_cam0
            wrong += found @ true < math.cos(math.radians(10.0)) * np.linalg.norm(true)
    assert wrong <= 8


@pytest.mark.parametrize(
    ("share", "shift_px", "most", "merged"),
    [(0.2, 3.0, 7, 9), (0.3, 3.0, 11, 25), (0.4, 6.0, 8, 30)],
)
def test_the_camera_moves_as_most_matches_do(share, shift_px, most, merged):
    """The likeliest motion alone is between both: 10, 29 and 34 of 40 are off by 0.1 deg."""
    scenes = [traffic(seed, share=share, shift_px=shift_px) for seed in range(40)]
    poses = [estimate(scene) for scene in scenes]
    pairs = list(zip(poses, scenes, strict=True))
    assert sum(off_deg(pose.rotation_cam1_from_cam0, scene) > 0.1 for pose, scene in pairs) <= most
    alone = [fit_of(s.points0, s.points1, s.camera).R_cam1_from_cam0 for s in scenes]
    assert sum(off_deg(*each) > 0.1 for each in zip(alone, scenes, strict=True)) >= merged


def test_what_moves_is_labelled_and_the_region_holds_the_truth():
    inside, labelled = [], []
    for seed in range(40):
        scene = traffic(seed, share=0.3, shift_px=6.0)
        if found_in(scene)[1] is None:
            continue
        pose = estimate(scene)
        assert pose.status is PoseStatus.OK
        assert "Independently moving object" in pose.reason
        turn = rotation_error(pose, scene.rotation_cam1_from_cam0)
        square = float(turn @ np.linalg.solve(pose.rotation_covariance, turn))
        inside.append(square <= chi2_quantile(0.95, 3))
        labelled.append(np.mean((pose.labels == 0) == scene.is_outlier))
    assert len(inside) >= 20
    assert np.mean(inside) > 0.8
    # What moves along its epipolar lines does not show.
    assert np.median(labelled) > 0.85


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_plain_noise_is_one_motion(share):
    """With or without wrong matches that have nothing in common."""
    for seed in range(20):
        scene, rng = traffic(seed, share=0.0, shift_px=0.0), np.random.default_rng(seed)
        wrong = rng.uniform(size=len(scene.points1)) < share
        points1 = scene.points1 + wrong[:, None] * rng.normal(0.0, 60.0, scene.points1.shape)
        assert explained(fit_of(scene.points0, points1, scene.camera)) is None


@pytest.mark.parametrize("size_px", [0.4, 1.0])
def test_smooth_errors_are_one_motion(size_px):
    """Such as those of a lens: a second motion gains likelihood, but separates no matches."""
    correlated = 0
    for seed in range(30):
        scene = smooth_errors(seed, baseline_m=0.3, size_px=size_px, reach_px=60.0)
        fit, two = found_in(scene)
        correlated += fit.neighbours.correlation > 0.5
        assert two is None
    assert correlated >= 20


def test_correlated_residuals_of_neighbours_are_reported():
    reasons = [
        estimate(smooth_errors(seed, baseline_m=0.3, size_px=size_px, reach_px=80.0)).reason
        for size_px in (0.0, 1.0)
        for seed in range(10)
    ]
    noted = ["Residuals of neighbouring matches are correlated" in each for each in reasons]
    assert not any(noted[:10])
    assert sum(noted[10:]) >= 7


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_wrong_matches_do_not_separate_smooth_errors(share):
    for seed in range(30):
        scene, rng = traffic(seed, share=0.0, shift_px=0.0), np.random.default_rng(seed)
        points1 = scene.points1 + smooth_field(seed, scene.points1, 0.5, 60.0)
        wrong = rng.uniform(size=len(points1)) < share
        points1[wrong] = rng.uniform((0.0, 0.0), scene.camera.size, (np.count_nonzero(wrong), 2))
        assert explained(fit_of(scene.points0, points1, scene.camera)) is None


@pytest.mark.parametrize("wrong_px", [None, 20.0, 30.0])
def test_wrong_matches_of_a_wide_image_are_no_second_motion(wrong_px):
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
    for seed in range(12):
        scene, rng = make_point_scene(options, seed=seed), np.random.default_rng(seed)
        points1 = scene.points1 + smooth_field(seed, scene.points1, 0.2)
        if wrong_px is not None:
            points1[:125] += rng.normal(0.0, wrong_px, (125, 2))
        assert explained(fit_of(scene.points0, points1, camera)) is None


def test_two_of_each_point_are_not_two_motions():
    """A point that was found twice shares all of its noise with itself."""
    scene = traffic(1, share=0.0, shift_px=0.0, matches=150)
    fit = fit_of(
        np.repeat(scene.points0, 2, axis=0), np.repeat(scene.points1, 2, axis=0), scene.camera
    )
    assert fit.neighbours.correlation > 0.99
    assert explained(fit) is None


def test_the_noise_is_that_of_one_motion():
    sigmas = []
    for seed in range(20):
        _, two = found_in(traffic(seed, share=0.4, shift_px=6.0))
        if two is not None:
            sigmas.append(two.fit.noise.sigma)
    assert len(sigmas) >= 15
    assert np.median(sigmas) == pytest.approx(NOISE_PX, rel=0.25)


def test_repeated_windows_with_a_common_motion_are_a_second_motion():
    """Half of the matches are of another window, and the likeliest motion lies between."""
    far_off = 0
    for seed in range(240):
        scene = court(seed, matches=500, repeated=0.5, whole=True)
        pose = estimate(scene)
        assert pose.rotation_cam1_from_cam0 is not None
        far_off += off_deg(pose.rotation_cam1_from_cam0, scene) > 1.0
    assert far_off <= 30  # of the likeliest single motion, 54 are


def test_many_samples_may_be_asked_for():
    options = RelativePoseOptions(min_iterations=500)
    pose = estimate(traffic(2, share=0.4, shift_px=6.0), options=options)
    assert pose.status is PoseStatus.OK


def test_densities_are_those_of_the_residuals():
    """In units of the noise, the density over a strip integrates to one."""
    scene = traffic(3, share=0.0, shift_px=0.0)
    fit = fit_of(scene.points0, scene.points1, scene.camera)
    r, density = fit.residual, np.exp(log_densities(fit.matches, fit))
    order = np.argsort(np.abs(r))
    sigma, tail = fit.noise.sigma, fit.noise.tail_share

    def expected(x: float, level: int = 0) -> float:
        """Core with the share 1 - tail, and so on, of sigmas that are 8 times larger each."""
        scale = sigma * math.sqrt(8.0) ** level
        core = math.exp(-0.5 * (x / scale) ** 2) / (math.sqrt(2.0 * math.pi) * scale)
        return core if level == 3 else (1.0 - tail) * core + tail * expected(x, level + 1)

    in_front = fit.parallax > 0.0
    rows = [k for k in order[::7] if in_front[k]]
    np.testing.assert_allclose(density[rows], [expected(r[k]) for k in rows], rtol=0.05)
    whole, _ = quad(expected, -60.0 * sigma, 60.0 * sigma, points=[0.0], limit=200)
    assert whole == pytest.approx(1.0, abs=0.01)


def test_matches_are_classified_by_the_mixture_of_both_motions():
    rng = np.random.default_rng(4)
    matches = matches_from_points(*rng.uniform(0.0, 400.0, (2, 1000, 2)), *[vga()] * 2)
    x = np.concatenate([rng.normal(0.0, 1.0, 600), rng.normal(8.0, 1.0, 400)])
    one, two = (-0.5 * (x - c) ** 2 - 0.5 * math.log(2.0 * math.pi) for c in (0.0, 8.0))
    follows, log_likelihoods = _classification(matches, one, two)
    np.testing.assert_array_equal(follows, np.repeat([0, 1], [600, 400]))
    expected = np.log(0.6 * np.exp(one) + 0.4 * np.exp(two)).sum()
    assert expected - 12.0 < log_likelihoods.sum() < expected + 2.0  # minus a little entropy
    # Two equal densities separate nothing.
    few = matches.select(np.arange(600))
    _, log_likelihoods = _classification(few, one[:600], one[:600])
    entropy = one[:600].sum() - log_likelihoods.sum()
    assert entropy == pytest.approx(600 * math.log(2.0), rel=0.1)


def vga() -> Camera:
    return Camera.pinhole(640, 480, 500.0, 500.0, 319.5, 239.5)


def test_few_matches_are_one_motion():
    scene = traffic(2, share=0.4, shift_px=6.0, matches=30)
    assert found_in(scene)[1] is None


def test_the_matches_of_the_second_motion_are_left_out():
    _, two = found_in(traffic(2, share=0.4, shift_px=6.0))
    assert two is not None
    assert isinstance(two.matches, Matches)
    assert len(two.matches) + two.following == 300


def test_the_ratio_is_that_of_the_classification_likelihood():
    """Mixture minus entropy minus Laplace's factors, over the design effect of one motion."""
    fit, two = found_in(traffic(4, share=0.4, shift_px=6.0))
    assert two is not None
    assert two.second is not None
    densities = (log_densities(fit.matches, each) for each in (two.fit, two.second))
    _, log_likelihoods = _classification(fit.matches, *densities)
    laplace = two.fit.laplace_factor + two.second.laplace_factor - fit.laplace_factor
    gain = np.sum(log_likelihoods - _log_likelihoods(fit.matches, fit)) - laplace
    expected = gain / fit.neighbours.design_effect
    assert two.log_ratio == pytest.approx(expected, rel=1e-3)
