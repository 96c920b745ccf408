"""The sink ``--bag FILE``: motions and poses as messages for filters and pose graphs in ROS."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from farpoint.aiding import MetricEstimate
from farpoint.camera import Camera
from farpoint.errors import InputError, require
from farpoint.odometry import OdometryResult
from farpoint.pose import PoseStatus, RelativePose
from farpoint.sinks.bag.axes import (
    BODY_FROM_OPTICAL,
    Twist,
    motion_twist,
    odom_from_body,
    pose_covariance,
)
from farpoint.sinks.bag.lengths import (
    UNKNOWN_SPEED,
    Length,
    MetricPath,
    length_in_metres,
    length_in_units,
)
from farpoint.sinks.bag.mcap_file import McapFile
from farpoint.sinks.bag.messages import Messages

__all__ = ["BODY_FRAME", "ODOM_FRAME", "OPTICAL_FRAME", "BagSink"]

ODOM_FRAME, BODY_FRAME, OPTICAL_FRAME = "odom", "camera_link", "camera_optical_frame"

_TOPICS = {
    "odometry": ("/farpoint/odometry", "nav_msgs/msg/Odometry"),
    "twist": ("/farpoint/twist", "geometry_msgs/msg/TwistWithCovarianceStamped"),
    "tf": ("/tf", "tf2_msgs/msg/TFMessage"),
    "tf_static": ("/tf_static", "tf2_msgs/msg/TFMessage"),
    "camera": ("/farpoint/camera_info", "sensor_msgs/msg/CameraInfo"),
    "diagnostics": ("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray"),
}
_NEVER = "{sec: 9223372036, nsec: 854775807}"
_LATCHED = (  # keep last 1, reliable, transient local: as rosbag2 writes the QoS of /tf_static
    "- history: 1\n  depth: 1\n  reliability: 1\n  durability: 1\n"
    f"  deadline: {_NEVER}\n  lifespan: {_NEVER}\n  liveliness: 1\n"
    f"  liveliness_lease_duration: {_NEVER}\n  avoid_ros_namespace_conventions: false"
)
_LEVELS = {
    PoseStatus.OK: 0,
    PoseStatus.STATIC: 0,
    PoseStatus.ROTATION_ONLY: 1,
    PoseStatus.FAILED: 2,
}


class BagSink:
    """Writes an MCAP file of ROS 2.

    Parameters
    ----------
    path : Path
        The file; an existing file is replaced.
    camera : callable
        Returns the current estimate of the camera.
    metres : callable, optional
        Returns the current estimate of metres per unit, or None before the first reading. Without
        this argument positions are in the unit of the path, and speeds are unknown.
    stamp_ns : callable, optional
        Returns the time of the current frame, ns, or None if the source has no times in ns. ROS
        looks up transforms by exact times, but a float of seconds since 1970 has a resolution of
        0.12 us only.

    Raises
    ------
    InputError
        If the file cannot be written. Methods also raise this error.
    MissingExtraError
        If rosbags is not installed.
    """

    def __init__(
        self,
        path: Path,
        camera: Callable[[], Camera],
        metres: Callable[[], MetricEstimate | None] | None = None,
        stamp_ns: Callable[[], int | None] = lambda: None,
    ) -> None:
        require("rosbags", extra="ros", purpose="writing a bag")
        if path.is_dir():
            raise InputError("is a folder; expected a file to write", file=path, field="--bag")
        self._camera, self._stamp_ns = camera, stamp_ns
        self._messages = Messages()
        self._path = MetricPath(metres)
        self._file = McapFile(path)
        self._channels = {
            key: self._file.add_channel(
                topic,
                kind,
                self._messages.definition(kind),
                _LATCHED if key == "tf_static" else None,
            )
            for key, (topic, kind) in _TOPICS.items()
        }
        self._begun = False

    def write(self, result: OdometryResult, image: np.ndarray | None) -> None:
        """Add the result of one frame; the image is not used."""
        del image
        time_ns = self._stamp_ns()
        if time_ns is None or time_ns / 10**9 != result.timestamp:  # not this frame's time
            time_ns = round(result.timestamp * 1e9)
        if time_ns < 0:
            raise InputError(f"ROS has no time {result.timestamp} s", field="--bag")
        make = self._messages
        if not self._begun:
            self._begun = True
            self._put("tf_static", time_ns, self._static(time_ns))
        pose, covariance = self._path.add(result)
        body, seconds = odom_from_body(pose), result.timestamp - result.timestamp0
        metric = self._path.estimate
        direct = _twist(result.pose, length_in_metres(result, metric, seconds), seconds)
        own = direct
        if metric is None:  # in the unit of the pose in the same message
            own = _twist(result.pose, length_in_units(result, seconds), seconds)
        odom = make.header(time_ns, ODOM_FRAME)
        self._put("tf", time_ns, make.transform(odom, BODY_FRAME, body))
        self._put(
            "odometry",
            time_ns,
            make.odometry(odom, BODY_FRAME, body, pose_covariance(covariance), own or _no_twist()),
        )
        if direct is not None:
            twist = make.twist(make.header(time_ns, BODY_FRAME), direct)
            self._put("twist", time_ns, twist)
        info = make.camera_info(make.header(time_ns, OPTICAL_FRAME), self._camera())
        if info is not None:
            self._put("camera", time_ns, info)
        self._put("diagnostics", time_ns, self._diagnostics(result, time_ns))
        self._file.write_chunk()

    def close(self) -> None:
        """Finish the file; a second call does nothing."""
        self._file.close()

    def _put(self, key: str, time_ns: int, message: Any) -> None:
        self._file.write(self._channels[key], time_ns, self._messages.serialize(message))

    def _static(self, time_ns: int) -> Any:
        body_from_optical = np.eye(4)
        body_from_optical[:3, :3] = BODY_FROM_OPTICAL
        header = self._messages.header(time_ns, BODY_FRAME)
        return self._messages.transform(header, OPTICAL_FRAME, body_from_optical)

    def _diagnostics(self, result: OdometryResult, time_ns: int) -> Any:
        pose = result.pose
        level, text = (0, "First frame.") if pose is None else (_LEVELS[pose.status], pose.reason)
        values = [
            ("status", "" if pose is None else pose.status.value),
            ("frames", f"{result.frame0} {result.frame1}"),
            ("segment", str(result.segment)),
            ("tracks", str(len(result.tracks))),
        ]
        if pose is not None and pose.noise_px is not None:
            values.append(("noise_px", repr(float(pose.noise_px))))
        header = self._messages.header(time_ns, "")
        return self._messages.diagnostics(header, level, text, values)


def _twist(pose: RelativePose | None, length: Length, seconds: float) -> Twist | None:
    """The velocity of a motion; None if unknown."""
    if pose is None or pose.rotation_cam1_from_cam0 is None or not seconds > 0.0:
        return None
    covariance, lever = np.zeros((6, 6)), np.zeros(3)
    assert pose.rotation_covariance is not None
    if pose.direction_cam1_from_cam0 is None:
        covariance[:3, :3] = pose.rotation_covariance
        covariance[3:, 3:] = (UNKNOWN_SPEED * seconds) ** 2 * np.eye(3)
        translation = lever
    else:
        assert pose.covariance is not None
        assert pose.direction_basis is not None
        direction = pose.direction_cam1_from_cam0
        J = np.zeros((6, 6))  # of [dtheta, dt] by [dtheta, dbeta, dlength]
        J[:3, :3] = np.eye(3)
        J[3:, 3:5] = length.lever * pose.direction_basis
        J[3:, 5] = direction
        errors = np.zeros((6, 6))
        errors[:5, :5] = pose.covariance
        errors[5, 5] = length.sigma**2
        covariance = J @ errors @ J.T
        translation, lever = length.value * direction, length.lever * direction
    return motion_twist(pose.rotation_cam1_from_cam0, translation, covariance, seconds, lever=lever)


def _no_twist() -> Twist:
    """Zero velocity with a very large covariance, for a frame whose motion is unknown."""
    unknown = np.diag([UNKNOWN_SPEED**2] * 3 + [np.pi**2 * 100.0] * 3)
    return Twist(linear=np.zeros(3), angular=np.zeros(3), covariance=unknown)
