"""A filter of ``robot_localization``'s form on the twists of a real drive stays consistent."""

from __future__ import annotations

from itertools import islice, pairwise
from pathlib import Path

import numpy as np
import pytest
from localization_filter import ANGLES, ANGULAR, LINEAR, POSITION, LocalizationFilter, rotation
from rosbags.highlevel import AnyReader
from scipy.stats import chi2

from farpoint.aiding import KnownSpeed, MetricEstimate, MetricScale
from farpoint.camera import load_camera
from farpoint.frames import open_frames
from farpoint.geometry import so3
from farpoint.odometry import Odometry
from farpoint.sinks.bag import BagSink
from farpoint.sinks.bag.axes import odom_from_body

FRAMES, STEP_S = 50, 0.1
TRUTH_RAD = 5e-4  # KITTI's poses are off by so much from frame to frame
CAR_NOISE = np.diag([1e-6] * 6 + [1.0] * 3 + [0.1] * 3 + [1.0] * 3)
"""Per second: a car that accelerates by some m/s^2, and moves as its velocities say."""

Twists = list[tuple[np.ndarray, np.ndarray]]


@pytest.fixture(scope="module")
def truth(shared_data: Path) -> np.ndarray:
    """Poses (N, 4, 4) of the body in ``odom``."""
    rows = np.loadtxt(shared_data / "kitti_a" / "poses.txt").reshape(-1, 3, 4)[:FRAMES]
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3] = rows
    return np.array([odom_from_body(np.linalg.inv(poses[0]) @ pose) for pose in poses])


@pytest.fixture(scope="module")
def twists(
    shared_data: Path, truth: np.ndarray, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Twists]:
    """Velocities and covariances as a filter gets them: in metres by a speed, and without."""
    folder, place = shared_data / "kitti_a", tmp_path_factory.mktemp("bags")
    # The lens of the rectified images is not exact.
    camera = load_camera(folder / "calib.txt").with_uncertainty(
        focal=0.01, center_px=5.0, distortion_px=3.0
    )
    steps = np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1)
    middles = STEP_S * (np.arange(len(steps)) + 0.5)
    scale = MetricScale([KnownSpeed(timestamps_s=middles, speeds=steps / STEP_S)])
    now: list[MetricEstimate | None] = [None]
    odometry = Odometry(camera)
    sinks = {
        "metric": BagSink(place / "metric.mcap", lambda: odometry.camera, lambda: now[0]),
        "free": BagSink(place / "free.mcap", lambda: odometry.camera),
    }
    for frame in islice(open_frames(folder), FRAMES):
        result = odometry.process(frame.image, frame.timestamp)
        now[0] = scale.add(odometry.camera, result)
        for sink in sinks.values():
            sink.write(result, None)
    for sink in sinks.values():
        sink.close()
    return {name: read_twists(place / f"{name}.mcap") for name in sinks}


def read_twists(path: Path) -> Twists:
    found = []
    with AnyReader([path]) as reader:
        connections = [c for c in reader.connections if c.topic == "/farpoint/twist"]
        for connection, _, data in reader.messages(connections):
            twist = reader.deserialize(data, connection.msgtype).twist  # type: ignore[attr-defined]
            numbers = [
                *(getattr(twist.twist.linear, axis) for axis in "xyz"),
                *(getattr(twist.twist.angular, axis) for axis in "xyz"),
            ]
            found.append((np.array(numbers), np.array(twist.covariance).reshape(6, 6)))
    return found


def test_the_filter_stays_consistent_and_is_led_by_the_motions(
    truth: np.ndarray, twists: dict[str, Twists]
):
    steps = [np.linalg.inv(a) @ b for a, b in pairwise(truth)]
    speeds = np.array([np.linalg.norm(step[:3, 3]) for step in steps]) / STEP_S
    allowance = np.diag([0.0] * 3 + [(TRUTH_RAD / STEP_S) ** 2] * 3)
    rng = np.random.default_rng(1)
    bound = chi2.ppf(0.999, 6)
    for name, measured in twists.items():
        assert len(measured) == FRAMES - 1
        ekf, nees = LocalizationFilter(CAR_NOISE), []
        for number, (twist, covariance) in enumerate(measured):
            ekf.advance(STEP_S)
            if name == "free":  # the wheels tell the speed, the camera all else
                wheels = np.array([speeds[number] + 0.05 * rng.normal()])
                ekf.update(slice(6, 7), wheels, np.array([[0.05**2]]))
                before = ekf.covariance[6, 6]
            ekf.update(slice(6, 12), twist, covariance + allowance)
            if name == "free":
                assert ekf.covariance[6, 6] > 0.98 * before
            pose = truth[number + 1]
            error = np.concatenate(
                [
                    pose[:3, 3] - ekf.state[POSITION],
                    so3.log(pose[:3, :3] @ rotation(ekf.state[ANGLES]).T),
                ]
            )
            nees.append(error @ np.linalg.solve(ekf.covariance[:6, :6], error))
        assert max(nees) < bound
        assert 0.5 < np.mean(nees) < 12.0
        # 58 m: the way across is what the direction of travel tells.
        assert np.linalg.norm(truth[-1][:3, 3] - ekf.state[POSITION]) < 1.5
        assert (np.sqrt(np.diag(ekf.covariance)[1:3]) < 1.0).all()
        assert ekf.state[LINEAR][0] == pytest.approx(speeds[-1], abs=0.3)
        assert np.linalg.norm(ekf.state[ANGULAR]) < 0.02


def test_the_linear_velocities_deviate_by_what_they_say(
    truth: np.ndarray, twists: dict[str, Twists]
):
    nees = []
    for number, (twist, covariance) in enumerate(twists["metric"]):
        step = np.linalg.inv(truth[number]) @ truth[number + 1]
        middle = so3.exp(-0.5 * so3.log(step[:3, :3]))
        error = twist[:3] - middle @ step[:3, 3] / STEP_S
        nees.append(error @ np.linalg.solve(covariance[:3, :3], error))
    assert 0.1 < np.median(nees) < 2.4  # the lens' errors are the same in all of them
    assert np.mean(nees) < chi2.ppf(0.999, 3)
