"""A car waits while a van crosses in front: it is STATIC, and drives on at its scale."""

from __future__ import annotations

from collections import Counter

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from farpoint import Camera, Odometry, OdometryResult, PoseStatus
from farpoint.geometry import so3
from farpoint.odometry.at_rest import at_rest
from farpoint.path.point import Rest
from farpoint.synthetic import RenderedSequence, street_drive
from farpoint.trajectory.files import Trajectory

CAMERA = Camera.pinhole(400, 300, 320.0, 320.0, 199.5, 149.5)
FPS, STANDING = 10.0, 9
VAN = (300, 150)  # px: so large that two views alone take some pairs for a motion


def stop_and_go() -> tuple[Trajectory, int, int]:
    """Poses along a street, and the first and last frame at which the car stands."""
    drive = street_drive(90, fps=FPS, seed=3).world_from_body
    at, speed, s = [], 1.0, 40.0
    for _ in range(9):
        at.append(s)
        s += speed
    while speed > 0.05:
        speed *= 0.5
        s += speed
        at.append(s)
    first = len(at)
    at += [s] * STANDING
    for k in range(6):
        s += min(1.0, 0.2 * (k + 1))
        at.append(s)
    frames = np.arange(90.0)
    poses = np.tile(np.eye(4), (len(at), 1, 1))
    poses[:, :3, :3] = Slerp(frames, Rotation.from_matrix(drive[:, :3, :3]))(at).as_matrix()
    for axis in range(3):
        poses[:, axis, 3] = np.interp(at, frames, drive[:, axis, 3])
    times = np.arange(len(at)) / FPS
    return Trajectory(timestamps=times, world_from_body=poses), first, first + STANDING


def crossed_by(image: np.ndarray, x: float, rng: np.random.Generator) -> np.ndarray:
    width, height = VAN
    small = np.random.default_rng(5).integers(0, 255, (height // 3, width // 3)).astype(np.uint8)
    van = cv2.GaussianBlur(cv2.resize(small, VAN, interpolation=cv2.INTER_CUBIC), (0, 0), 1.5)
    warp = np.array([[1.0, 0.0, x], [0.0, 1.0, 150.0]], np.float32)
    size = image.shape[::-1]
    over = cv2.warpAffine(van, warp, size).astype(np.float32)
    mask = cv2.warpAffine(np.ones_like(van, np.float32), warp, size)
    mixed = image * (1 - mask) + mask * (over + rng.normal(0, 1.0, image.shape))
    return np.clip(np.rint(mixed), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def drive() -> tuple[list[OdometryResult], np.ndarray, int, int]:
    path, first, last = stop_and_go()
    sequence = RenderedSequence(CAMERA, path, seed=3)
    odometry, rng, results = Odometry(CAMERA), np.random.default_rng(0), []
    for index, frame in enumerate(sequence):
        image = frame.image
        if first <= index < last:
            image = crossed_by(image, -VAN[0] + 40.0 + 25.0 * (index - first), rng)
        results.append(odometry.process(image, index / FPS))
    return results, sequence.world_from_cam[:, :3, 3], first, last


def test_it_stands(drive):
    results, _, first, last = drive
    counts = Counter(result.pose.status for result in results[first:last])
    assert counts[PoseStatus.OK] == 0
    assert counts[PoseStatus.FAILED] == 0
    reasons = [result.pose.reason for result in results[first:last]]
    assert any(reason.startswith("Independently moving object") for reason in reasons)
    at = np.array([result.world_from_cam[:3, 3] for result in results[first:last]])
    assert np.linalg.norm(at - at[0], axis=1).max() < 0.05  # of a step


@pytest.mark.parametrize(
    ("angle_rad", "status", "words"),
    [
        (0.0, PoseStatus.STATIC, "the camera is at rest."),
        (0.01, PoseStatus.ROTATION_ONLY, "the camera rotates without a translation."),
    ],
)
def test_the_reason_names_an_object_before_a_camera_at_rest(drive, angle_rad, status, words):
    moving = next(r.pose for r in drive[0] if r.pose and r.pose.status is PoseStatus.OK)
    turn = so3.exp(np.array([0.0, angle_rad, 0.0]))
    rest = Rest(rotation_cam1_from_cam0=turn, rotation_covariance=1e-8 * np.eye(3), points=40)
    pose = at_rest(moving, rest)
    assert pose.status is status
    assert pose.reason.startswith("Independently moving object: 40 points of known distance ")
    assert pose.reason.endswith(words)


def test_it_drives_on_at_its_scale(drive):
    results, true, first, last = drive
    at = np.array([result.world_from_cam[:3, 3] for result in results])

    def ratio(begin: int, end: int) -> float:
        steps, true_steps = (np.diff(p[begin:end], axis=0) for p in (at, true))
        return np.linalg.norm(steps, axis=1).sum() / np.linalg.norm(true_steps, axis=1).sum()

    assert ratio(last, len(at)) / ratio(0, first) == pytest.approx(1.0, abs=0.05)
    assert {result.segment for result in results} == {0}
    assert not any(result.scale_is_guessed for result in results)
