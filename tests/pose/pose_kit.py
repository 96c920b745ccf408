"""What the tests of the estimator share: soundness of a result, errors, and plain scenes."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from farpoint import PoseStatus, RelativePose, estimate_relative_pose
from farpoint.geometry import so3
from farpoint.synthetic import PointScene, PointSceneOptions, make_point_scene, paper_camera

TURN_RAD = (0.02, 0.05, -0.03)


def point_scene(seed: int, **options) -> PointScene:
    """A scene seen by the paper's camera, which turns a little; options as `PointSceneOptions`."""
    options = {"camera": paper_camera(), "rotation_vector_rad": TURN_RAD, **options}
    return make_point_scene(PointSceneOptions(**options), seed=seed)


def estimate(scene: PointScene, **arguments) -> RelativePose:
    return estimate_relative_pose(scene.points0, scene.points1, scene.camera, **arguments)


def rotation_error(pose: RelativePose, R_true: np.ndarray) -> np.ndarray:
    """``dtheta`` (3,) with ``R_true = Exp(dtheta) @ R_est``."""
    assert pose.rotation_cam1_from_cam0 is not None
    return so3.log(R_true @ pose.rotation_cam1_from_cam0.T)


def direction_error(pose: RelativePose, direction_true: np.ndarray) -> np.ndarray:
    """``dbeta`` (2,) with ``direction_true = normalize(direction_est + basis @ dbeta)``."""
    assert pose.direction_cam1_from_cam0 is not None
    assert pose.direction_basis is not None
    along = pose.direction_cam1_from_cam0 @ direction_true
    return pose.direction_basis.T @ direction_true / along


def pose_error(pose: RelativePose, scene: PointScene) -> np.ndarray:
    """``[dtheta, dbeta]`` (5,) from the estimate to the truth."""
    assert scene.direction_cam1_from_cam0 is not None
    return np.concatenate(
        [
            rotation_error(pose, scene.rotation_cam1_from_cam0),
            direction_error(pose, scene.direction_cam1_from_cam0),
        ]
    )


def assert_sound(pose: RelativePose, matches: int) -> None:
    """Whatever the data: the promised fields are there, finite, and mean what they say."""
    assert pose.labels.shape == (matches,)
    assert pose.labels.dtype == np.uint8
    assert pose.labels.max(initial=0) <= 2
    counts = np.bincount(pose.labels, minlength=3)
    stats = pose.stats
    assert (stats.outliers, stats.far, stats.near, stats.matches) == (*counts, matches)
    assert_sentence(pose.reason)
    if pose.status is PoseStatus.FAILED:
        assert pose.rotation_cam1_from_cam0 is None
        assert pose.rotation_covariance is None
        assert pose.noise_px is None
        assert counts[0] == matches
    else:
        assert pose.rotation_cam1_from_cam0 is not None
        R = pose.rotation_cam1_from_cam0
        np.testing.assert_allclose(R @ R.T, np.eye(3), rtol=0.0, atol=1e-9)
        assert np.linalg.det(R) > 0.0
        assert_covariance(pose.rotation_covariance, 3)
        assert pose.noise_px is not None
        assert 0.0 < pose.noise_px < np.inf
    direction_fields = (
        pose.direction_cam1_from_cam0,
        pose.direction_basis,
        pose.covariance,
        pose.heading_cam0,
        pose.heading_covariance,
    )
    if pose.status is not PoseStatus.OK:
        assert all(value is None for value in direction_fields)
        return
    assert pose.direction_cam1_from_cam0 is not None
    assert pose.direction_basis is not None
    frame = np.column_stack([pose.direction_basis, pose.direction_cam1_from_cam0])
    np.testing.assert_allclose(frame.T @ frame, np.eye(3), rtol=0.0, atol=1e-9)
    assert_covariance(pose.covariance, 5)
    assert np.array_equal(pose.covariance[:3, :3], pose.rotation_covariance)


def assert_covariance(covariance: np.ndarray | None, size: int) -> None:
    assert covariance is not None
    assert covariance.shape == (size, size)
    assert np.isfinite(covariance).all()
    np.testing.assert_allclose(
        covariance, covariance.T, rtol=0.0, atol=1e-12 * np.abs(covariance).max()
    )
    # Judged as a correlation, which does not care how certain the axes are.
    sigma = np.sqrt(np.diag(covariance))
    assert (sigma > 0.0).all()
    assert np.linalg.eigvalsh(covariance / np.outer(sigma, sigma))[0] > 0.0


def assert_sentence(reason: str) -> None:
    assert reason[0].isupper() or reason[0].isdigit()
    assert reason.endswith(".")
    assert "\n" not in reason
    assert len(reason.split()) >= 4
    assert not any(word in reason for word in ("nan", "inf ", "None"))


def assert_identical(a: RelativePose, b: RelativePose) -> None:
    """Bit for bit, the clock aside."""
    for field in fields(RelativePose):
        left, right = getattr(a, field.name), getattr(b, field.name)
        if field.name == "stats":
            for name in ("matches", "far", "near", "outliers", "iterations", "cost"):
                assert getattr(left, name) == getattr(right, name), name
            assert left.sign_probability == right.sign_probability
        elif isinstance(left, np.ndarray):
            assert left.tobytes() == right.tobytes(), field.name
        else:
            assert left == right, field.name
