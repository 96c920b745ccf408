"""Frames, signs and sides: exact scenes written down without farpoint's own generator."""

from __future__ import annotations

import numpy as np
import pytest
from pose_kit import assert_sound, estimate, point_scene

from farpoint import (
    Camera,
    PoseStatus,
    RelativePose,
    TrackLabel,
    estimate_relative_pose,
    estimate_relative_pose_from_rays,
)
from farpoint.geometry import so3, sphere

WIDTH, HEIGHT, FOCAL, CX, CY = 640, 480, 500.0, 320.0, 230.0
CAMERA = Camera.pinhole(WIDTH, HEIGHT, FOCAL, FOCAL, CX, CY)
MOTIONS = {
    "forward": ([0.0, 0.0, 0.0], [0.0, 0.0, -0.3]),
    "backward": ([0.0, 0.01, 0.0], [0.0, 0.0, 0.3]),
    "right": ([0.01, -0.02, 0.03], [-0.2, 0.0, 0.0]),
    "down": ([0.0, 0.0, 0.1], [0.0, -0.2, 0.0]),
    "any": ([0.05, -0.1, 0.08], [0.2, 0.1, -0.15]),
}


def pixels(X: np.ndarray) -> np.ndarray:
    """The pinhole written out: x right, y down, z forward."""
    return np.stack([FOCAL * X[:, 0] / X[:, 2] + CX, FOCAL * X[:, 1] / X[:, 2] + CY], axis=1)


def box_of_points(count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.uniform([-2.0, -1.5, 3.0], [2.0, 1.5, 8.0], (count, 3))


def exact_pose(rotation_vector: list[float], t: np.ndarray, seed: int = 0) -> RelativePose:
    X = box_of_points(60, seed)
    moved = X @ so3.exp(np.array(rotation_vector)).T + t
    return estimate_relative_pose(pixels(X), pixels(moved), CAMERA)


@pytest.mark.parametrize(("rotation_vector", "t"), MOTIONS.values(), ids=MOTIONS.keys())
def test_exact_matches_give_the_exact_motion(rotation_vector, t):
    pose = exact_pose(rotation_vector, np.array(t))
    assert pose.status is PoseStatus.OK
    assert_sound(pose, 60)
    np.testing.assert_allclose(
        pose.rotation_cam1_from_cam0, so3.exp(np.array(rotation_vector)), rtol=0.0, atol=1e-8
    )
    np.testing.assert_allclose(
        pose.direction_cam1_from_cam0, np.array(t) / np.linalg.norm(t), rtol=0.0, atol=1e-7
    )


@pytest.mark.parametrize(("rotation_vector", "t"), MOTIONS.values(), ids=MOTIONS.keys())
def test_the_heading_is_where_the_camera_goes(rotation_vector, t):
    # The centre of camera 1 in camera 0: X1 = R X0 + t is zero at X0 = -R^T t.
    centre = -so3.exp(np.array(rotation_vector)).T @ np.array(t)
    pose = exact_pose(rotation_vector, np.array(t))
    np.testing.assert_allclose(
        pose.heading_cam0, centre / np.linalg.norm(centre), rtol=0.0, atol=1e-7
    )


def test_driving_forward_is_plus_z_and_its_pixel_is_the_epipole():
    pose = exact_pose([0.0, 0.0, 0.0], np.array([0.0, 0.0, -0.5]))
    np.testing.assert_allclose(pose.heading_cam0, [0.0, 0.0, 1.0], rtol=0.0, atol=1e-7)
    epipole = CAMERA.project(pose.heading_cam0[None])[0]
    np.testing.assert_allclose(epipole, [CX, CY], rtol=0.0, atol=1e-4)
    # Points flow away from it.
    X = box_of_points(60, 0)
    flow = pixels(X - [0.0, 0.0, 0.5]) - pixels(X)
    assert (np.sum(flow * (pixels(X) - epipole), axis=1) > 0).all()


def test_the_papers_rotation_and_translation_are_ours_transposed_and_negated():
    # P' = R_p^T P - T_p
    R_p, T_p = so3.exp(np.array([0.04, -0.02, 0.05])), np.array([0.1, -0.2, 0.3])
    X = box_of_points(60, 2)
    moved = np.array([R_p.T @ P - T_p for P in X])
    pose = estimate_relative_pose(pixels(X), pixels(moved), CAMERA)
    np.testing.assert_allclose(pose.rotation_cam1_from_cam0, R_p.T, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(
        pose.direction_cam1_from_cam0, -T_p / np.linalg.norm(T_p), rtol=0.0, atol=1e-7
    )


def test_swapping_the_images_inverts_the_motion():
    scene = point_scene(1, outliers=10)
    there = estimate(scene)
    back = estimate_relative_pose(scene.points1, scene.points0, scene.camera)
    sigma = np.sqrt(np.diag(there.rotation_covariance).max())
    assert so3.angle_between(back.rotation_cam1_from_cam0.T, there.rotation_cam1_from_cam0) < (
        0.1 * sigma
    )
    assert sphere.angle_between(back.direction_cam1_from_cam0, there.heading_cam0) < 1e-3


def noisy_rays(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Rays of two views with a large turn, so that the sides of a perturbation differ."""
    rng = np.random.default_rng(seed)
    X = box_of_points(80, seed)
    moved = X @ so3.exp(np.array([0.2, 0.9, -0.4])).T + [0.4, -0.2, 0.3]
    return tuple(
        sphere.normalize(sphere.normalize(P) + 3e-4 * rng.normal(size=P.shape)) for P in (X, moved)
    )


def pose_of(rays0: np.ndarray, rays1: np.ndarray) -> RelativePose:
    pose = estimate_relative_pose_from_rays(rays0, rays1, noise_rad=3e-4)
    assert pose.status is PoseStatus.OK
    return pose


def similar(actual: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_allclose(actual, expected, rtol=0.0, atol=0.02 * np.abs(expected).max())


def test_covariances_are_stated_in_camera_1_and_in_the_basis_given():
    # Turning camera 1 turns everything that is stated in its axes; turning camera 0 nothing.
    rays0, rays1 = noisy_rays(0)
    Q = so3.exp(np.array([0.5, -0.7, 0.6]))
    plain, turned1, turned0 = (
        pose_of(rays0, rays1),
        pose_of(rays0, rays1 @ Q.T),
        pose_of(rays0 @ Q.T, rays1),
    )

    def whole(pose: RelativePose, turn: np.ndarray) -> np.ndarray:
        """Covariance (6, 6) of rotation and direction as vectors of camera 1, turned."""
        J = np.zeros((6, 5))
        J[:3, :3], J[3:, 3:] = turn, turn @ pose.direction_basis
        return J @ pose.covariance @ J.T

    # The estimate itself follows; sigmas here are some 1e-4.
    np.testing.assert_allclose(
        turned1.rotation_cam1_from_cam0, Q @ plain.rotation_cam1_from_cam0, rtol=0.0, atol=2e-5
    )
    np.testing.assert_allclose(
        turned0.rotation_cam1_from_cam0, plain.rotation_cam1_from_cam0 @ Q.T, rtol=0.0, atol=2e-5
    )
    similar(whole(turned1, np.eye(3)), whole(plain, Q))
    similar(whole(turned0, np.eye(3)), whole(plain, np.eye(3)))
    # The other side would tell the difference.
    wrong = whole(plain, np.eye(3))
    assert np.abs(whole(turned1, np.eye(3)) - wrong).max() > 0.2 * np.abs(wrong).max()


def test_the_covariance_of_the_heading_is_that_of_the_direction_seen_from_camera_0():
    pose = pose_of(*noisy_rays(1))
    R, t, B = pose.rotation_cam1_from_cam0, pose.direction_cam1_from_cam0, pose.direction_basis
    rng = np.random.default_rng(0)
    steps = rng.multivariate_normal(np.zeros(5), pose.covariance, 4000)
    headings = np.array([-(so3.exp(x[:3]) @ R).T @ sphere.retract(t, B, x[3:]) for x in steps])
    similarity = np.cov((headings - pose.heading_cam0).T)
    scale = np.abs(pose.heading_covariance).max()
    # A variance from 4000 samples is known to 2.2 %.
    np.testing.assert_allclose(similarity, pose.heading_covariance, rtol=0.0, atol=0.08 * scale)
    along = pose.heading_cam0 @ pose.heading_covariance @ pose.heading_cam0
    assert abs(along) < 1e-9 * scale


def test_labels_tell_far_near_and_wrong_matches():
    far = point_scene(3, matches=100, outliers=20, far_range_m=(np.inf, np.inf))
    pose = estimate(far)
    assert pose.labels.dtype == np.uint8
    labels = [(TrackLabel.OUTLIER, 0), (TrackLabel.FAR, 1), (TrackLabel.NEAR, 2)]
    assert [int(label) for label, _ in labels] == [value for _, value in labels]
    near = ~far.is_outlier & ~far.is_far
    # At 1-4 m and 30 cm forward a point near the epipole still does not move.
    assert (pose.labels[near] == TrackLabel.NEAR).mean() > 0.9
    assert (pose.labels[near] != TrackLabel.OUTLIER).mean() > 0.95
    assert (pose.labels[far.is_far] == TrackLabel.FAR).mean() > 0.95
    # A wrong match on its epipolar line by chance is none that anyone can tell.
    assert (pose.labels[far.is_outlier] == TrackLabel.OUTLIER).mean() > 0.85


def test_the_noise_is_that_of_one_coordinate_of_one_image():
    sigmas = [
        estimate(point_scene(s, matches=200, outliers=20, noise_px=0.4)).noise_px for s in range(12)
    ]
    # One residual per match, 175 degrees of freedom: 5 % each, 1.5 % of their mean.
    assert np.mean(sigmas) == pytest.approx(0.4, rel=0.05)


def test_noise_of_rays_is_a_multiple_of_what_was_stated():
    rays0, rays1 = noisy_rays(2)
    stated = estimate_relative_pose_from_rays(rays0, rays1, noise_rad=3e-4)
    halved = estimate_relative_pose_from_rays(rays0, rays1, noise_rad=1.5e-4)
    assert stated.noise_px == pytest.approx(1.0, abs=0.25)
    assert halved.noise_px == pytest.approx(2.0 * stated.noise_px, rel=0.02)
    similar(halved.covariance, stated.covariance)
