"""Noise told match by match, two cameras, and rays instead of pixels."""

from __future__ import annotations

import numpy as np
import pytest
from pose_kit import assert_identical, estimate, point_scene, pose_error

from farpoint import (
    Camera,
    PoseStatus,
    RelativePoseOptions,
    TrackLabel,
    estimate_relative_pose,
    estimate_relative_pose_from_rays,
)
from farpoint.geometry import so3, sphere
from farpoint.synthetic import PointScene

FIELDS = ("covariance0_px2", "covariance1_px2")


def noisy(scene: PointScene, covariance_px2: np.ndarray, seed: int) -> tuple[np.ndarray, ...]:
    """Both images with noise of these covariances (N, 2, 2) on top of a scene without any."""
    rng = np.random.default_rng(seed)
    factor = np.linalg.cholesky(covariance_px2)
    noise = np.einsum("nij,knj->kni", factor, rng.normal(size=(2, len(factor), 2)))
    return scene.points0 + noise[0], scene.points1 + noise[1]


def uneven(count: int) -> np.ndarray:
    """Every second point ten times as noisy as the others."""
    sigma = np.where(np.arange(count) % 2, 2.0, 0.2)
    return sigma[:, None, None] ** 2 * np.eye(2)


def along_edges(count: int) -> np.ndarray:
    """Points on edges: well known across, poorly along."""
    angle = np.random.default_rng(5).uniform(0.0, np.pi, count)
    turn = np.stack([np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)], axis=1)
    turn = turn.reshape(count, 2, 2)
    return turn @ np.diag([2.0**2, 0.2**2]) @ turn.swapaxes(1, 2)


@pytest.mark.parametrize("shape", [uneven, along_edges])
def test_telling_the_noise_makes_the_estimate_better_and_keeps_it_honest(shape):
    covariance = shape(120)
    told, untold, nees = [], [], []
    for seed in range(40):
        scene = point_scene(
            seed, matches=120, outliers=0, noise_px=0.0, translation_m=(0.2, 0.1, -0.2)
        )
        points = noisy(scene, covariance, seed)
        plain = estimate_relative_pose(*points, scene.camera)
        given = estimate_relative_pose(
            *points, scene.camera, covariance0_px2=covariance, covariance1_px2=covariance
        )
        assert given.status is PoseStatus.OK
        if plain.status is not PoseStatus.OK:
            continue
        error = pose_error(given, scene)
        told.append(error)
        untold.append(pose_error(plain, scene))
        nees.append(error @ np.linalg.solve(given.covariance, error))
    assert len(told) >= 30
    rms = [np.sqrt(np.mean(np.square(e), axis=0)) for e in (told, untold)]
    assert (rms[0] < 0.9 * rms[1]).all()
    assert np.mean(rms[0] / rms[1]) < 0.8
    # Five degrees of freedom; 40 trials know the mean to 0.5.
    assert 3.3 < np.mean(nees) < 7.5


def test_only_the_shape_of_the_noise_is_believed_not_its_size():
    scene = point_scene(2, matches=80)
    covariance = along_edges(80)
    once, fourfold = (
        estimate(scene, **dict.fromkeys(FIELDS, factor * covariance)) for factor in (1.0, 4.0)
    )
    assert_identical(once, fourfold)


@pytest.mark.parametrize(
    "translation_m", [(0.2, 0.1, -0.2), (0.0, 0.0, 0.0)], ids=["moved", "turned"]
)
@pytest.mark.parametrize(
    "told", [None, 3.0 * np.tile(np.eye(2), (80, 1, 1))], ids=["untold", "told"]
)
def test_an_error_common_to_all_matches_is_added_once(translation_m, told):
    scene = point_scene(2, matches=80, outliers=0, translation_m=translation_m)
    noise = dict.fromkeys(FIELDS, told)
    plain = estimate(scene, **noise)
    shifted = estimate(scene, options=RelativePoseOptions(shared_error_px=0.5), **noise)
    assert shifted.status is plain.status
    extra = shifted.rotation_covariance - plain.rotation_covariance
    # A pixel at the median distance from the centre of a 65-degree lens sees a little less.
    one_px = 0.5 / scene.camera.model.fx
    np.testing.assert_allclose(extra, extra[0, 0] * np.eye(3), atol=1e-12)
    assert 0.75 * one_px**2 < extra[0, 0] < one_px**2
    if plain.covariance is not None:
        extra = shifted.covariance - plain.covariance
        np.testing.assert_array_equal(extra[3:], 0.0)


def test_equal_isotropic_noise_is_the_same_as_none_given():
    scene = point_scene(3)
    told = estimate(scene, **dict.fromkeys(FIELDS, np.tile(0.25 * np.eye(2), (110, 1, 1))))
    plain = estimate(scene)
    np.testing.assert_allclose(told.rotation_cam1_from_cam0, plain.rotation_cam1_from_cam0)
    np.testing.assert_allclose(told.covariance, plain.covariance, rtol=1e-6)
    assert told.noise_px == pytest.approx(plain.noise_px)


@pytest.mark.parametrize("field", FIELDS)
def test_the_other_image_has_noise_of_the_same_mean_size(field):
    scene = point_scene(3)
    plain = estimate(scene)
    told = estimate(scene, **{field: np.tile(9.0 * np.eye(2), (110, 1, 1))})
    np.testing.assert_allclose(told.rotation_cam1_from_cam0, plain.rotation_cam1_from_cam0)
    assert told.noise_px == pytest.approx(plain.noise_px)


@pytest.mark.parametrize("variance_px2", [100.0, 1e4, 1e6])
def test_a_match_with_a_huge_covariance_does_no_harm(variance_px2):
    scene = point_scene(4, matches=100, outliers=0)
    covariance = np.tile(0.05 * np.eye(2), (100, 1, 1))
    covariance[0] = variance_px2 * np.eye(2)
    pose = estimate(scene, **dict.fromkeys(FIELDS, covariance))
    rest = estimate_relative_pose(scene.points0[1:], scene.points1[1:], scene.camera)
    assert pose.status is PoseStatus.OK
    sigma = np.sqrt(np.trace(rest.rotation_covariance))
    assert (
        so3.angle_between(pose.rotation_cam1_from_cam0, rest.rotation_cam1_from_cam0) < 0.1 * sigma
    )
    assert (pose.labels[1:] != TrackLabel.OUTLIER).mean() > 0.95


def two_cameras() -> tuple[Camera, Camera]:
    return (
        Camera.pinhole(640, 480, 700.0, 690.0, 310.0, 245.0),
        Camera.pinhole(1280, 720, 900.0, 905.0, 650.0, 350.0, (-0.1, 0.02, 1e-3, -5e-4)),
    )


def test_two_cameras():
    camera0, camera1 = two_cameras()
    R, t = so3.exp(np.array([0.05, -0.1, 0.02])), np.array([-0.25, 0.02, 0.01])
    rng = np.random.default_rng(0)
    X = rng.uniform([-1.0, -0.7, 3.0], [1.0, 0.7, 9.0], (80, 3))
    points0, points1 = camera0.project(X), camera1.project(X @ R.T + t)
    exact = estimate_relative_pose(points0, points1, camera0, camera1)
    np.testing.assert_allclose(exact.rotation_cam1_from_cam0, R, rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(
        exact.direction_cam1_from_cam0, sphere.normalize(t), rtol=0.0, atol=1e-6
    )
    noise = rng.normal(0.0, 0.3, (2, 80, 2))
    pose = estimate_relative_pose(points0 + noise[0], points1 + noise[1], camera0, camera1)
    assert pose.status is PoseStatus.OK
    assert pose.noise_px == pytest.approx(0.3, rel=0.3)
    # Each ray carries the noise of its own camera: taking one for the other is another motion.
    swapped = estimate_relative_pose(points0, points1, camera1, camera0)
    assert swapped.status is not PoseStatus.OK or (
        so3.angle_between(swapped.rotation_cam1_from_cam0, R) > 0.01
    )


def test_one_camera_stands_for_both():
    scene = point_scene(0)
    assert_identical(
        estimate(scene),
        estimate_relative_pose(scene.points0, scene.points1, scene.camera, scene.camera),
    )


@pytest.mark.parametrize("seed", range(5))
def test_rays_and_pixels_give_the_same_motion(seed):
    scene = point_scene(seed, translation_m=(0.2, 0.1, -0.2))
    pixels = estimate(scene)
    rays = estimate_relative_pose_from_rays(
        scene.camera.unproject(scene.points0),
        scene.camera.unproject(scene.points1),
        noise_rad=scene.noise_px / 727.0,
    )
    assert rays.status is pixels.status is PoseStatus.OK
    # Pixels at the border are finer than those in the middle, which rays do not tell.
    difference = so3.log(rays.rotation_cam1_from_cam0 @ pixels.rotation_cam1_from_cam0.T)
    assert difference @ np.linalg.solve(pixels.rotation_covariance, difference) < 1.0
    assert sphere.angle_between(
        rays.direction_cam1_from_cam0, pixels.direction_cam1_from_cam0
    ) < np.sqrt(np.trace(pixels.covariance[3:, 3:]))
    assert (rays.labels == pixels.labels).mean() > 0.9
    assert rays.noise_px == pytest.approx(pixels.noise_px / scene.noise_px, rel=0.2)


def test_rays_behind_the_camera_and_motions_in_any_direction():
    rng = np.random.default_rng(4)
    for k in range(10):
        X = 5.0 * rng.normal(size=(80, 3))
        R, t = so3.exp(rng.normal(size=3)), sphere.normalize(rng.normal(size=3))
        rays0, rays1 = sphere.normalize(X), sphere.normalize(X @ R.T + t)
        pose = estimate_relative_pose_from_rays(rays0, rays1, noise_rad=1e-4, seed=k)
        assert pose.status is PoseStatus.OK
        assert so3.angle_between(pose.rotation_cam1_from_cam0, R) < 1e-6
        assert sphere.angle_between(pose.direction_cam1_from_cam0, t) < 1e-6
