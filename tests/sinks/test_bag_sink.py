"""``--bag``: what rosbags reads back; frames and twists against numerical derivatives."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.highlevel import AnyReader
from scipy.linalg import expm

from farpoint.aiding import MetricEstimate
from farpoint.camera import Camera, DoubleSphere, KannalaBrandt, Pinhole
from farpoint.errors import InputError, MissingExtraError
from farpoint.frames.bags import open_bag
from farpoint.geometry import so3
from farpoint.odometry import OdometryResult
from farpoint.pose import PoseStatus, RelativePose, TrackLabel, estimate_relative_pose, failed_pose
from farpoint.sinks.bag import BagSink
from farpoint.sinks.bag.axes import (
    BODY_FROM_OPTICAL,
    motion_twist,
    odom_from_body,
    pose_covariance,
)
from farpoint.tracks import Tracks

CAMERA = Camera.pinhole(640, 480, 500.0, 501.0, 319.5, 239.5, (0.1, -0.02, 0.001, 0.002))
START_S, STEP_S = 1000.0, 0.1


def camera_at(time_s: float) -> np.ndarray:
    """A smooth path (4, 4), world_from_cam, in the axes of a camera: forward, and turning."""
    pose = np.eye(4)
    pose[:3, :3] = so3.exp(np.array([0.1 * np.sin(time_s), 0.4 * time_s, 0.05 * time_s]))
    pose[:3, 3] = [0.5 * time_s**2, 0.1 * np.sin(2 * time_s), 8.0 * time_s]
    return pose


def motion(time0_s: float, time1_s: float, *, seed: int = 0) -> RelativePose:
    """A pose with exact rotation and direction, and some covariance."""
    cam1_from_cam0 = np.linalg.inv(camera_at(time1_s)) @ camera_at(time0_s)
    rng = np.random.default_rng(seed)
    points = rng.uniform([-5, -3, 4], [5, 3, 30], (80, 3))
    points1 = points @ cam1_from_cam0[:3, :3].T + cam1_from_cam0[:3, 3]
    pixels = CAMERA.project(points), CAMERA.project(points1)
    return estimate_relative_pose(*pixels, CAMERA, seed=0)


def result(
    number: int, pose: RelativePose | None, *, segment: int = 0, scale: float | None = None
) -> OdometryResult:
    time_s = number * STEP_S
    A = np.random.default_rng(number).normal(size=(7, 7)) * 1e-2
    before = max(number - 1, 0)
    length = float(np.linalg.norm(camera_at(time_s)[:3, 3] - camera_at(before * STEP_S)[:3, 3]))
    return OdometryResult(
        frame0=before,
        frame1=number,
        timestamp0=START_S + before * STEP_S,
        timestamp=START_S + time_s,
        pose=pose,
        tracks=Tracks.empty(),
        world_from_cam=camera_at(time_s) if number else np.eye(4),
        scale=length if scale is None and pose is not None else scale,
        scale_sigma=0.01,
        world_covariance=A @ A.T,
        segment=segment,
    )


def read(path: Path) -> dict[str, list[Any]]:
    """By rosbags itself."""
    found: dict[str, list[Any]] = {}
    with AnyReader([path]) as reader:
        for connection, time_ns, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append(message)
            if hasattr(message, "header"):
                stamp = message.header.stamp
                assert stamp.sec * 10**9 + stamp.nanosec == time_ns
    return found


def write(
    path: Path, results: list[OdometryResult], camera: Camera = CAMERA, metres: Any = None
) -> dict[str, list[Any]]:
    sink = BagSink(path, lambda: camera, metres)
    for one in results:
        sink.write(one, None)
    sink.close()
    sink.close()
    return read(path)


def drive(count: int = 5) -> list[OdometryResult]:
    poses = [None, *(motion((k - 1) * STEP_S, k * STEP_S) for k in range(1, count))]
    return [result(k, pose) for k, pose in enumerate(poses)]


def vector(message: Any) -> np.ndarray:
    return np.array([message.x, message.y, message.z])


def transform_of(stamped: Any) -> np.ndarray:
    T = np.eye(4)
    q = stamped.transform.rotation
    T[:3, :3] = so3.matrix_from_quat_xyzw(np.array([q.x, q.y, q.z, q.w]))
    T[:3, 3] = vector(stamped.transform.translation)
    return T


def test_rosbags_and_farpoint_read_every_message(tmp_path: Path):
    path = tmp_path / "out.mcap"
    found = write(path, drive())
    counts = {topic: len(messages) for topic, messages in found.items()}
    assert counts == {
        "/farpoint/odometry": 5,
        "/farpoint/twist": 4,
        "/tf": 5,
        "/tf_static": 1,
        "/farpoint/camera_info": 5,
        "/diagnostics": 5,
    }
    assert {topic.name: topic.count for topic in open_bag(path).topics()} == counts


def test_body_and_optical_frame_are_those_of_rep_103(tmp_path: Path):
    found = write(tmp_path / "out.mcap", drive())
    static = found["/tf_static"][0].transforms[0]
    assert (static.header.frame_id, static.child_frame_id) == (
        "camera_link",
        "camera_optical_frame",
    )
    body_from_optical = transform_of(static)[:3, :3]
    # x forward is the optical z, y left its -x, z up its -y.
    np.testing.assert_allclose(body_from_optical @ [0, 0, 1], [1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(body_from_optical @ [1, 0, 0], [0, -1, 0], atol=1e-15)
    np.testing.assert_allclose(body_from_optical @ [0, 1, 0], [0, 0, -1], atol=1e-15)
    for number, (tf, odometry) in enumerate(
        zip(found["/tf"], found["/farpoint/odometry"], strict=True)
    ):
        stamped = tf.transforms[0]
        assert (stamped.header.frame_id, stamped.child_frame_id) == ("odom", "camera_link")
        assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom", "camera_link")
        odom_from_optical = transform_of(stamped) @ transform_of(static)
        # odom is the first body, the world the first camera.
        expected = transform_of(static) @ (camera_at(number * STEP_S) if number else np.eye(4))
        np.testing.assert_allclose(odom_from_optical, expected, atol=1e-12)
        np.testing.assert_allclose(
            vector(odometry.pose.pose.position), transform_of(stamped)[:3, 3]
        )


def test_the_twist_is_the_derivative_of_the_path(tmp_path: Path):
    found = write(
        tmp_path / "out.mcap",
        drive(4),
        metres=lambda: MetricEstimate(metres_per_unit=1.0, sigma=0.01),
    )
    for number, message in enumerate(found["/farpoint/twist"], start=1):
        assert message.header.frame_id == "camera_link"
        middle_s, h = (number - 0.5) * STEP_S, 1e-6
        before, after = (odom_from_body(camera_at(middle_s + side * h)) for side in (-1, 1))
        R = odom_from_body(camera_at(middle_s))[:3, :3]
        linear = R.T @ (after[:3, 3] - before[:3, 3]) / (2 * h)
        angular = so3.log(before[:3, :3].T @ after[:3, :3]) / (2 * h)
        np.testing.assert_allclose(vector(message.twist.twist.linear), linear, atol=0.03)
        np.testing.assert_allclose(vector(message.twist.twist.angular), angular, atol=0.003)
        assert vector(message.twist.twist.linear)[0] > 7.9  # forward is x


VECTORS = st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3).map(np.array)


@given(phi=VECTORS, t=VECTORS, seed=st.integers(0, 1000))
@settings(max_examples=60, deadline=None)
def test_the_twist_leads_from_one_camera_to_the_next(phi: np.ndarray, t: np.ndarray, seed: int):
    R, seconds = so3.exp(1.7 * phi), 0.25
    A = np.random.default_rng(seed).normal(size=(6, 6)) * 1e-3
    twist = motion_twist(R, t, A @ A.T, seconds)
    generator = np.zeros((4, 4))
    generator[:3, :3], generator[:3, 3] = so3.skew(twist.angular), twist.linear
    body0_from_body1 = expm(generator * seconds)
    cam1_from_cam0 = np.eye(4)
    cam1_from_cam0[:3, :3], cam1_from_cam0[:3, 3] = R, t
    np.testing.assert_allclose(
        body0_from_body1, odom_from_body(np.linalg.inv(cam1_from_cam0)), atol=1e-9
    )
    # The covariance by central differences.
    J, h = np.empty((6, 6)), 1e-5
    for k, step in enumerate(np.eye(6) * h):
        ends = [
            motion_twist(so3.exp(sign * step[:3]) @ R, t + sign * step[3:], A @ A.T, seconds)
            for sign in (1, -1)
        ]
        J[:, k] = np.concatenate(
            [ends[0].linear - ends[1].linear, ends[0].angular - ends[1].angular]
        ) / (2 * h)
    expected = J @ A @ A.T @ J.T
    np.testing.assert_allclose(twist.covariance, expected, atol=1e-5 * np.abs(expected).max())


def test_the_pose_covariance_is_that_of_errors_about_fixed_axes():
    A = np.random.default_rng(5).normal(size=(7, 7))
    covariance = pose_covariance(A @ A.T)
    pose = camera_at(0.7)
    J, h = np.empty((6, 6)), 1e-6
    for k, step in enumerate(np.eye(6) * h):  # [dtheta, dp] in the world of the camera
        moved = pose.copy()
        moved[:3, :3] = so3.exp(step[:3]) @ pose[:3, :3]
        moved[:3, 3] += step[3:]
        a, b = odom_from_body(moved), odom_from_body(pose)
        J[:3, k] = (a[:3, 3] - b[:3, 3]) / h
        J[3:, k] = so3.log(a[:3, :3] @ b[:3, :3].T) / h
    np.testing.assert_allclose(covariance, J @ (A @ A.T)[:6, :6] @ J.T, atol=1e-5)


def matrix(message: Any) -> np.ndarray:
    return np.array(message.covariance).reshape(6, 6)


def test_without_a_length_the_variance_along_the_direction_is_without_use(tmp_path: Path):
    results = drive(2)
    message = write(tmp_path / "out.mcap", results)["/farpoint/twist"][0].twist
    pose = results[1].pose
    assert pose is not None
    assert pose.heading_cam0 is not None
    assert pose.rotation_cam1_from_cam0 is not None
    along = BODY_FROM_OPTICAL @ pose.rotation_cam1_from_cam0 @ pose.heading_cam0
    velocity = vector(message.twist.linear)
    np.testing.assert_allclose(velocity / np.linalg.norm(velocity), along, atol=0.02)
    block = matrix(message)[:3, :3]
    assert along @ block @ along == pytest.approx(1e6, rel=0.01)
    # The smallest two eigenvalues: the direction, at 30 m/s.
    sigmas = np.sqrt(np.linalg.eigvalsh(block)[:2])
    assert pose.covariance is not None
    beta = np.sqrt(np.linalg.eigvalsh(pose.covariance[3:, 3:]))
    np.testing.assert_allclose(sigmas, 30.0 * beta, rtol=0.5)
    assert (np.linalg.eigvalsh(matrix(message)) > 0.0).all()


def test_aiding_measurements_put_poses_and_speeds_in_metres(tmp_path: Path):
    estimates = iter([None, None, *[MetricEstimate(metres_per_unit=2.0, sigma=0.03)] * 3])
    now: list[MetricEstimate | None] = [None]
    sink = BagSink(tmp_path / "out.mcap", lambda: CAMERA, lambda: now[0])
    results = drive(5)
    for one in results:
        now[0] = next(estimates)
        sink.write(one, None)
    sink.close()
    found = read(tmp_path / "out.mcap")
    odometry = found["/farpoint/odometry"]
    unsure = [matrix(message.pose)[0, 0] > 1e5 for message in odometry]
    assert unsure == [True, True, False, False, False]
    for number in (2, 3, 4):
        expected = 2.0 * odom_from_body(camera_at(number * STEP_S))[:3, 3]
        np.testing.assert_allclose(vector(odometry[number].pose.pose.position), expected)
        # The error of the scale lies along the way.
        sigma = np.sqrt(expected @ matrix(odometry[number].pose)[:3, :3] @ expected)
        assert sigma > 0.03 * expected @ expected
    last = found["/farpoint/twist"][-1].twist
    speed = np.linalg.norm(vector(last.twist.linear))
    assert results[4].scale is not None
    assert speed == pytest.approx(2.0 * results[4].scale / STEP_S, rel=0.01)
    along = vector(last.twist.linear) / speed
    sigma = np.sqrt(along @ matrix(last)[:3, :3] @ along)
    assert sigma == pytest.approx(np.hypot(0.03 * speed, 2.0 * 0.01 / STEP_S), rel=0.1)


def test_statuses_say_what_is_known(tmp_path: Path):
    moving = motion(0.0, STEP_S)
    turned = replace(
        moving,
        status=PoseStatus.ROTATION_ONLY,
        direction_cam1_from_cam0=None,
        direction_basis=None,
        covariance=None,
        labels=np.full(len(moving.labels), TrackLabel.FAR),
    )
    results = [
        result(0, None),
        result(1, moving),
        result(2, turned),
        result(3, failed_pose("Too dark.")),
        result(4, failed_pose("A cut."), segment=1),
    ]
    found = write(tmp_path / "out.mcap", results)
    statuses = [message.status[0] for message in found["/diagnostics"]]
    assert [status.level for status in statuses] == [0, 0, 1, 2, 2]
    assert statuses[3].message == "Too dark."
    assert {pair.key: pair.value for pair in statuses[4].values}["segment"] == "1"
    assert len(found["/farpoint/twist"]) == 2
    turning = matrix(found["/farpoint/twist"][1].twist)
    assert (np.diag(turning)[:3] > 9e5).all()
    assert (np.diag(turning)[3:] < 1e-2).all()
    last = np.diag(matrix(found["/farpoint/odometry"][4].pose))
    assert (last[:3] > 9e5).all()
    assert (last[3:] > 9.0).all()


@pytest.mark.parametrize(
    ("model", "name", "d"),
    [
        (Pinhole(fx=9.0, fy=8.0, cx=7.0, cy=6.0), "plumb_bob", [0.0] * 5),
        (
            Pinhole(fx=9.0, fy=8.0, cx=7.0, cy=6.0, distortion=(1, 2, 3, 4)),
            "plumb_bob",
            [1, 2, 3, 4, 0],
        ),
        (
            Pinhole(fx=9.0, fy=8.0, cx=7.0, cy=6.0, distortion=tuple(range(8))),
            "rational_polynomial",
            list(range(8)),
        ),
        (
            KannalaBrandt(fx=9.0, fy=8.0, cx=7.0, cy=6.0, k1=0.1, k2=0.2, k3=0.3, k4=0.4),
            "equidistant",
            [0.1, 0.2, 0.3, 0.4],
        ),
    ],
)
def test_the_lens_goes_out_as_it_comes_in(
    tmp_path: Path, model: Pinhole | KannalaBrandt, name: str, d: list[float]
):
    camera = Camera(model=model, size=(16, 12))
    info = write(tmp_path / "out.mcap", drive(1), camera)["/farpoint/camera_info"][0]
    assert (info.width, info.height, info.distortion_model) == (16, 12, name)
    np.testing.assert_array_equal(info.d, d)
    np.testing.assert_array_equal(info.k, [9, 0, 7, 0, 8, 6, 0, 0, 1])
    np.testing.assert_array_equal(info.p, [9, 0, 7, 0, 0, 8, 6, 0, 0, 0, 1, 0])


def test_a_lens_without_a_name_in_ros_is_left_out(tmp_path: Path):
    model = DoubleSphere(fx=9.0, fy=8.0, cx=7.0, cy=6.0, xi=0.1, alpha=0.5)
    found = write(tmp_path / "out.mcap", drive(1), Camera(model=model, size=(16, 12)))
    assert "/farpoint/camera_info" not in found


def test_a_run_that_is_killed_leaves_whole_chunks(tmp_path: Path):
    sink = BagSink(tmp_path / "out.mcap", lambda: CAMERA)
    poses = drive(3)
    for number in range(60):
        sink.write(replace(poses[2], timestamp=START_S + number, timestamp0=START_S), None)
    bag = open_bag(tmp_path / "out.mcap")  # while it is written
    count = {topic.name: topic.count for topic in bag.topics()}["/farpoint/odometry"]
    assert count is not None
    assert 40 <= count <= 60
    faults = [message.fault for message in bag.messages(["/tf"]) if message.fault]
    assert faults == [f"out.mcap is damaged at byte {bag.path.stat().st_size} of "
                      f"{bag.path.stat().st_size} (the file ends without its last record): "
                      "reading stopped"]  # fmt: skip
    sink.close()
    assert len(read(tmp_path / "out.mcap")["/farpoint/odometry"]) == 60


def test_what_cannot_be_written_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(InputError, match="is a folder"):
        BagSink(tmp_path, lambda: CAMERA)
    with pytest.raises(InputError, match="cannot be written"):
        BagSink(tmp_path / "nowhere" / "out.mcap", lambda: CAMERA)
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    with pytest.raises(MissingExtraError, match=r"farpoint\[ros\]"):
        BagSink(tmp_path / "out.mcap", lambda: CAMERA)
