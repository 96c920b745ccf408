"""Results made up from an exact scene, so that sinks can be tested without the estimator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from farpoint.camera import Camera
from farpoint.geometry.sphere import normalize, tangent_basis
from farpoint.odometry import OdometryResult
from farpoint.pose import PoseStats, PoseStatus, RelativePose, TrackLabel
from farpoint.tracks import Tracks

MakeResult = Callable[..., OdometryResult]

_FAR, _NEAR, _WRONG = 30, 50, 8


@pytest.fixture(scope="session")
def camera() -> Camera:
    return Camera.pinhole(640, 480, 500, 500, 319.5, 239.5)


@pytest.fixture(scope="session")
def make_result(camera: Camera) -> MakeResult:
    """``make_result(frame, status=..., heading=..., sigma_deg=..., reason=...)``."""

    def make(
        frame: int = 1,
        status: PoseStatus = PoseStatus.OK,
        heading: tuple[float, float, float] = (0.2, 0.05, 1.0),
        sigma_deg: float = 0.7,
        reason: str = "made up",
        scene_camera: Camera = camera,
    ) -> OdometryResult:
        if frame == 0:
            return first_result()
        R = Rotation.from_rotvec([0.004, 0.03, -0.01]).as_matrix()
        direction = normalize(-R @ np.array(heading))
        tracks, labels = scene_tracks(scene_camera, R, direction, frame)
        pose = made_up_pose(R, direction, labels, np.deg2rad(sigma_deg), reason, frame)
        return OdometryResult(
            frame0=frame - 1,
            frame1=frame,
            timestamp0=100.0 + (frame - 1) * 0.1,
            timestamp=100.0 + frame * 0.1,
            pose=with_status(pose, status),
            tracks=tracks,
            world_from_cam=world_from_cam(frame),
            scale=1.0 if status is PoseStatus.OK else None,
            scale_sigma=None,
        )

    return make


def first_result() -> OdometryResult:
    return OdometryResult(
        frame0=0,
        frame1=0,
        timestamp0=100.0,
        timestamp=100.0,
        pose=None,
        tracks=Tracks.empty(),
        world_from_cam=np.eye(4),
        scale=None,
        scale_sigma=None,
    )


def scene_tracks(
    camera: Camera, R: np.ndarray, direction: np.ndarray, seed: int
) -> tuple[Tracks, np.ndarray]:
    """Far, near and wrong matches of a scene that the camera sees well."""
    assert camera.size is not None
    rng = np.random.default_rng(seed)
    count = _FAR + _NEAR + _WRONG
    pixels = rng.uniform(0.1, 0.9, (count, 2)) * camera.size
    depth = np.where(np.arange(count) < _FAR, 1e6, rng.uniform(4.0, 12.0, count))
    points0 = camera.unproject(pixels) * depth[:, None]
    points1 = camera.project(points0 @ R.T + 0.4 * direction)
    points1[_FAR + _NEAR :] += rng.uniform(-40, 40, (_WRONG, 2))
    labels = np.repeat(
        np.array([TrackLabel.FAR, TrackLabel.NEAR, TrackLabel.OUTLIER], np.uint8),
        [_FAR, _NEAR, _WRONG],
    )
    covariance = np.broadcast_to(0.04 * np.eye(2), (count, 2, 2))
    ids = np.arange(count)
    return Tracks(ids=ids, points0=pixels, points1=points1, covariance_px2=covariance), labels


def made_up_pose(
    R: np.ndarray,
    direction: np.ndarray,
    labels: np.ndarray,
    sigma_rad: float,
    reason: str,
    seed: int,
) -> RelativePose:
    root = np.random.default_rng(1000 + seed).normal(size=(5, 5)) * 0.3 + np.eye(5)
    root *= np.array([0.03, 0.03, 0.03, 1.0, 1.0])[:, None] * sigma_rad
    covariance = root @ root.T
    return RelativePose(
        status=PoseStatus.OK,
        reason=reason,
        rotation_cam1_from_cam0=R,
        rotation_covariance=covariance[:3, :3],
        direction_cam1_from_cam0=direction,
        direction_basis=tangent_basis(direction),
        covariance=covariance,
        labels=labels,
        noise_px=0.2137,
        stats=PoseStats(
            matches=len(labels),
            far=_FAR,
            near=_NEAR,
            outliers=_WRONG,
            iterations=40,
            cost=1.1,
            sign_probability=1.0,
            sharing=1.0,
            half_ratio=None,
            search_s=0.001,
            refinement_s=0.002,
            covariance_s=0.0005,
        ),
    )


def with_status(pose: RelativePose, status: PoseStatus) -> RelativePose:
    if status is PoseStatus.OK:
        return pose
    pose = replace(
        pose,
        status=status,
        direction_cam1_from_cam0=None,
        direction_basis=None,
        covariance=None,
    )
    if status is not PoseStatus.FAILED:
        return pose
    count = len(pose.labels)
    return replace(
        pose,
        rotation_cam1_from_cam0=None,
        rotation_covariance=None,
        noise_px=None,
        labels=np.zeros(count, np.uint8),
        stats=replace(pose.stats, far=0, near=0, outliers=count),
    )


def world_from_cam(frame: int) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec([0.0, 0.01 * frame, 0.0]).as_matrix()
    pose[:3, 3] = [0.05 * frame**1.1, 0.0, 0.3 * frame]
    return pose
