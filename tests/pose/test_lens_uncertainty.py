"""Motions by a lens that is uncertain: covariances that hold its uncertainty."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from pose_kit import assert_sound, direction_error, point_scene, rotation_error

from farpoint import PoseStatus, RelativePose, estimate_relative_pose
from farpoint.camera import Camera, CameraUncertainty, HorizontalField, covariance_factor
from farpoint.synthetic import PointScene, paper_camera

WIDTH, HEIGHT = 640, 480
GUESS = HorizontalField(degrees=70.0).camera(WIDTH, HEIGHT)


def true_camera(rng: np.random.Generator) -> Camera:
    """One of the cameras of which the guess could be meant."""
    lens, factor = GUESS.model.refinable(), covariance_factor(GUESS.parameter_covariance())
    given = np.array(list(lens.parameters.values()))
    model = lens.with_parameters(given + factor @ rng.normal(size=factor.shape[1]))
    return Camera(model=model, size=(WIDTH, HEIGHT))


def scene(seed: int, baseline_m: float) -> PointScene:
    rng = np.random.default_rng(seed)
    turn, step = rng.normal(size=(2, 3))
    turn *= math.radians(rng.uniform(0.5, 8.0)) / np.linalg.norm(turn)
    step *= baseline_m / np.linalg.norm(step)
    return point_scene(
        seed,
        camera=true_camera(rng),
        matches=150,
        outliers=20,
        noise_px=0.3,
        rotation_vector_rad=tuple(turn),
        translation_m=tuple(step),
    )


def estimate(scene: PointScene, camera: Camera, **arguments) -> RelativePose:
    return estimate_relative_pose(scene.points0, scene.points1, camera, **arguments)


def nees(pose: RelativePose, scene: PointScene) -> tuple[float, float]:
    """Squared errors of rotation and direction in terms of their covariances."""
    assert pose.covariance is not None
    turn = rotation_error(pose, scene.rotation_cam1_from_cam0)
    across = direction_error(pose, scene.direction_cam1_from_cam0)
    return (
        float(turn @ np.linalg.solve(pose.covariance[:3, :3], turn)),
        float(across @ np.linalg.solve(pose.covariance[3:, 3:], across)),
    )


def test_covariances_allow_for_the_guess():
    exact = GUESS.with_uncertainty()
    squares = {"as if calibrated": [], "uncertain": []}
    for seed in range(200):
        made = scene(seed, baseline_m=0.2)
        plain, uncertain = estimate(made, exact), estimate(made, GUESS)
        np.testing.assert_array_equal(
            uncertain.rotation_cam1_from_cam0, plain.rotation_cam1_from_cam0
        )
        for name, pose in (("as if calibrated", plain), ("uncertain", uncertain)):
            if pose.status is PoseStatus.OK:
                squares[name].append(nees(pose, made))
    print(
        {
            k: (len(v), np.mean(np.array(v) < (7.815, 5.991), axis=0), np.median(v, axis=0))
            for k, v in squares.items()
        }
    )
    assert len(squares["uncertain"]) > 180
    limits = 7.815, 5.991  # 95 % of chi-square with 3 and 2 degrees of freedom
    assert (np.mean(np.array(squares["as if calibrated"]) < limits, axis=0) < 0.7).all()
    # Three standard deviations of the share of 180 around 0.95, and a few scenes in which the lens
    # is too far off for a first-order propagation.
    assert (np.mean(np.array(squares["uncertain"]) < limits, axis=0) > 0.9).all()
    # Honest, not only large: the medians of chi-square are 2.37 and 1.39.
    medians = np.median(squares["uncertain"], axis=0)
    assert ((medians / (2.37, 1.39) > 0.5) & (medians / (2.37, 1.39) < 1.3)).all()


@pytest.mark.parametrize("baseline_m", [0.2, 0.0])
def test_the_covariance_increases_by_the_effect_of_another_lens(baseline_m: float):
    """``J S J.T`` against estimates by lenses that are off by a tenth of a sigma each way."""
    camera = paper_camera().with_uncertainty(focal=0.01, center_px=2.0, distortion_px=1.0)
    lens, factor = camera.model.refinable(), covariance_factor(camera.parameter_covariance())
    given, step = np.array(list(lens.parameters.values())), 0.1
    made = point_scene(
        5,
        camera=camera,
        matches=300,
        outliers=0,
        noise_px=0.05,
        translation_m=(0.4 * baseline_m, 0.1 * baseline_m, 0.9 * baseline_m),
    )
    pose = estimate(made, camera)
    known = pose.covariance if pose.covariance is not None else pose.rotation_covariance
    exact = estimate(made, camera.with_uncertainty())
    own = exact.covariance if exact.covariance is not None else exact.rotation_covariance
    assert known.shape == own.shape
    expected = np.zeros_like(own)
    for column in factor.T:
        changed = [
            estimate(
                made,
                replace(
                    camera,
                    model=lens.with_parameters(given + sign * step * column),
                    uncertainty=None,
                ),
            )
            for sign in (1.0, -1.0)
        ]
        change = [_change(pose, other) for other in changed]
        by_lens = (change[0] - change[1])[: len(own)] / (2.0 * step)
        expected += np.outer(by_lens, by_lens)
    print(np.sqrt(np.diag(expected)), np.sqrt(np.diag(known - own)))
    np.testing.assert_allclose(known - own, expected, atol=0.05 * np.abs(expected).max())


def _change(pose: RelativePose, other: RelativePose) -> np.ndarray:
    turn = rotation_error(pose, other.rotation_cam1_from_cam0)
    if pose.direction_cam1_from_cam0 is None:
        return turn
    return np.concatenate([turn, direction_error(pose, other.direction_cam1_from_cam0)])


def test_a_turn_seen_through_a_wrong_lens_is_no_translation():
    exact, false = GUESS.with_uncertainty(), {"as if calibrated": 0, "uncertain": 0}
    for seed in range(60):
        made = scene(seed, baseline_m=0.0)
        plain, uncertain = estimate(made, exact), estimate(made, GUESS)
        false["as if calibrated"] += plain.status is PoseStatus.OK
        false["uncertain"] += uncertain.status is PoseStatus.OK
        if uncertain.status is not plain.status:
            assert "lens within its stated uncertainty" in uncertain.reason
        assert_sound(uncertain, len(made))
    print(false)
    assert false["as if calibrated"] > 20
    assert false["uncertain"] <= 3


def test_an_exact_camera_changes_no_digit():
    made = scene(3, baseline_m=0.2)
    exact = estimate(made, made.camera)
    also = estimate(made, made.camera.with_uncertainty(focal=0.01).with_uncertainty())
    np.testing.assert_array_equal(exact.covariance, also.covariance)


def test_errors_of_two_cameras_are_independent():
    """Errors of one camera, alike in both images, cancel in the rotation of a pure step."""
    made = point_scene(7, rotation_vector_rad=(0.0, 0.0, 0.0), translation_m=(0.3, 0.0, 0.0))
    one = made.camera.with_uncertainty(focal=0.01)
    other = replace(
        one, name="the other", uncertainty=CameraUncertainty(focal=0.01, center_px=1e-9)
    )
    both = [estimate(made, one), estimate_relative_pose(made.points0, made.points1, one, other)]
    same, independent = (np.trace(pose.rotation_covariance) for pose in both)
    assert independent > 3.0 * same


def test_a_distortion_in_pixels_needs_the_size_of_the_image():
    made = scene(3, baseline_m=0.2)
    camera = replace(made.camera, size=None).with_uncertainty(distortion_px=1.0)
    with pytest.raises(ValueError, match=r"camera\.size"):
        estimate(made, camera)


def test_the_reason_states_the_widened_sigma_of_the_direction():
    made = scene(3, baseline_m=0.4)
    exact, uncertain = estimate(made, GUESS.with_uncertainty()), estimate(made, GUESS)
    assert exact.status is uncertain.status is PoseStatus.OK
    sigmas = []
    for pose in (exact, uncertain):
        sigma = np.degrees(np.sqrt(np.linalg.eigvalsh(pose.covariance[3:, 3:])[-1]))
        assert f"1-sigma of {sigma:.2g} deg" in pose.reason
        sigmas.append(sigma)
    assert sigmas[1] > 1.1 * sigmas[0]
