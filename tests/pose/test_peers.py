"""Other people's estimators on the same matches, and the textbook's Sampson distance."""

from __future__ import annotations

import numpy as np
import pytest
from pose_kit import estimate, point_scene

from farpoint import PoseStatus, TrackLabel
from farpoint._kernels.constants import LONG_TAIL
from farpoint._kernels.likelihood import evaluate_residuals
from farpoint._kernels.pose import LinearisationPoint
from farpoint.geometry import so3, sphere
from farpoint.pose.matches import matches_from_points
from farpoint.synthetic import PointScene

Motion = tuple[np.ndarray, np.ndarray]
EASY = [
    point_scene(
        seed,
        matches=250,
        outliers=60,
        far_share=0.2,
        near_range_m=(2.0, 8.0),
        rotation_vector_rad=(0.05, -0.08, 0.04),
        translation_m=translation,
        noise_px=0.3,
    )
    for seed, translation in enumerate([(0.5, 0.1, -0.3), (-0.1, 0.0, -0.8), (-0.6, 0.2, 0.3)])
]


K = np.array([[727.0, 0.0, 319.5], [0.0, 727.0, 239.5], [0.0, 0.0, 1.0]])


def by_opencv(scene: PointScene, method: str) -> Motion:
    cv2 = pytest.importorskip("cv2")
    cv2.setRNGSeed(1)
    E, mask = cv2.findEssentialMat(
        scene.points0, scene.points1, K, getattr(cv2, method), 0.9999, 1.0
    )
    _, R, t, _ = cv2.recoverPose(E, scene.points0, scene.points1, K, mask=mask)
    return R, t.ravel()


def by_poselib(scene: PointScene) -> Motion:
    poselib = pytest.importorskip("poselib")
    lens = {
        "model": "PINHOLE",
        "width": 640,
        "height": 480,
        # PoseLib, as COLMAP, would count from the corner of the pixel; both images shift alike.
        "params": [727.0, 727.0, 319.5, 239.5],
    }
    pose, _ = poselib.estimate_relative_pose(
        scene.points0, scene.points1, lens, lens, {"max_epipolar_error": 1.0}, {}
    )
    return pose.R, sphere.normalize(np.asarray(pose.t))


def assert_close(scene: PointScene, motion: Motion, rotation_rad: float, direction_rad: float):
    pose = estimate(scene)
    assert pose.status is PoseStatus.OK
    R, t = motion
    assert so3.angle_between(pose.rotation_cam1_from_cam0, R) < rotation_rad
    assert sphere.angle_between(pose.direction_cam1_from_cam0, t) < direction_rad


@pytest.mark.parametrize("scene", EASY, ids=["sideways", "forward", "backward"])
def test_opencvs_usac_agrees(scene):
    # Not refined to the likelihood: half a degree is what it reaches.
    assert_close(scene, by_opencv(scene, "USAC_MAGSAC"), 0.005, 0.03)


@pytest.mark.parametrize("scene", EASY, ids=["sideways", "forward", "backward"])
def test_poselib_agrees(scene):
    # Refined as this one is: the rest is the choice of inliers.
    assert_close(scene, by_poselib(scene), 1e-3, 5e-3)


@pytest.mark.parametrize("scene", EASY, ids=["sideways", "forward", "backward"])
def test_the_truth_agrees_best(scene):
    truth = scene.rotation_cam1_from_cam0, scene.direction_cam1_from_cam0
    assert_close(scene, truth, 1e-3, 5e-3)
    pose = estimate(scene)
    near = ~scene.is_outlier & ~scene.is_far
    assert (pose.labels[near] == TrackLabel.NEAR).mean() > 0.95


@pytest.mark.parametrize("scene", EASY, ids=["sideways", "forward", "backward"])
def test_the_residual_is_the_sampson_distance_of_the_textbook(scene):
    """Hartley and Zisserman, Multiple View Geometry, eq. 11.9, for K, E on the image plane."""
    K_inverse = np.linalg.inv(K)
    R, t = scene.rotation_cam1_from_cam0, scene.direction_cam1_from_cam0
    assert t is not None
    F = K_inverse.T @ so3.skew(t) @ R @ K_inverse
    x0 = np.c_[scene.points0, np.ones(250)]
    x1 = np.c_[scene.points1, np.ones(250)]
    line1, line0 = x0 @ F.T, x1 @ F
    norm = np.sqrt(np.sum(line1[:, :2] ** 2 + line0[:, :2] ** 2, axis=1))
    textbook_px = np.sum(x1 * line1, axis=1) / norm
    matches = matches_from_points(scene.points0, scene.points1, scene.camera, scene.camera)
    everyone = matches.weights()
    residual_px, parallax, right = np.empty((3, len(everyone)))
    seen = LinearisationPoint(
        matches.pairs,
        everyone,
        R,
        t,
        np.array([1.0, 0.1, 0.1, 0.1]),
        matches.outlier_half_width,
        LONG_TAIL,
    )
    evaluate_residuals(seen, residual_px, parallax, right)
    residual_px = residual_px[:250]
    true = ~scene.is_outlier
    assert np.abs(textbook_px[true]).max() > 0.5
    np.testing.assert_allclose(residual_px[true], textbook_px[true], rtol=5e-3, atol=1e-6)
