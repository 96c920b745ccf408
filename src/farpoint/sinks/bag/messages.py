"""ROS 2 messages made from plain numbers with the types of rosbags."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from farpoint.camera import Camera, KannalaBrandt, Pinhole
from farpoint.errors import optional_import
from farpoint.geometry import so3
from farpoint.sinks.bag.axes import Twist

__all__ = ["Messages"]

_RATIONAL = 5  # largest number of coefficients of ROS's model plumb_bob


class Messages:
    """Makes ROS 2 messages, and converts messages to bytes in CDR."""

    def __init__(self) -> None:
        typesys = optional_import("rosbags.typesys", extra="ros", purpose="writing a bag")
        self._store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)

    def definition(self, name: str) -> str:
        """The definition of a type in ROS's language."""
        return self._store.generate_msgdef(name, ros_version=2)[0]

    def serialize(self, message: Any) -> memoryview:
        """The bytes of a message."""
        return self._store.serialize_cdr(message, message.__msgtype__)

    def header(self, time_ns: int, frame_id: str) -> Any:
        """``std_msgs/Header``."""
        stamp = self._make("builtin_interfaces/Time", sec=time_ns // 10**9, nanosec=time_ns % 10**9)
        return self._make("std_msgs/Header", stamp=stamp, frame_id=frame_id)

    def odometry(
        self, header: Any, child: str, pose: np.ndarray, covariance: np.ndarray, twist: Twist
    ) -> Any:
        """``nav_msgs/Odometry`` of a pose (4, 4) and its covariance (6, 6) in ROS's order."""
        place = self._make(
            "geometry_msgs/Pose",
            position=self._make("geometry_msgs/Point", **_xyz(pose[:3, 3])),
            orientation=self._quaternion(pose[:3, :3]),
        )
        return self._make(
            "nav_msgs/Odometry",
            header=header,
            child_frame_id=child,
            pose=self._make(
                "geometry_msgs/PoseWithCovariance", pose=place, covariance=_flat(covariance)
            ),
            twist=self._twist(twist),
        )

    def twist(self, header: Any, twist: Twist) -> Any:
        """``geometry_msgs/TwistWithCovarianceStamped``."""
        name = "geometry_msgs/TwistWithCovarianceStamped"
        return self._make(name, header=header, twist=self._twist(twist))

    def transform(self, header: Any, child: str, parent_from_child: np.ndarray) -> Any:
        """``tf2_msgs/TFMessage`` with one transform (4, 4)."""
        transform = self._make(
            "geometry_msgs/Transform",
            translation=self._vector(parent_from_child[:3, 3]),
            rotation=self._quaternion(parent_from_child[:3, :3]),
        )
        stamped = self._make(
            "geometry_msgs/TransformStamped",
            header=header,
            child_frame_id=child,
            transform=transform,
        )
        return self._make("tf2_msgs/TFMessage", transforms=[stamped])

    def camera_info(self, header: Any, camera: Camera) -> Any | None:
        """``sensor_msgs/CameraInfo``; None for a lens model that ROS does not have."""
        model, size = camera.model, camera.size
        if size is None or not isinstance(model, Pinhole | KannalaBrandt):
            return None
        if isinstance(model, KannalaBrandt):
            name, d = "equidistant", (model.k1, model.k2, model.k3, model.k4)
        else:
            d = model.distortion or (0.0,) * 5
            name = "plumb_bob" if len(d) <= _RATIONAL else "rational_polynomial"
            d = (*d, *(0.0,) * (_RATIONAL - len(d)))
        K = np.array([[model.fx, 0.0, model.cx], [0.0, model.fy, model.cy], [0.0, 0.0, 1.0]])
        return self._make(
            "sensor_msgs/CameraInfo",
            header=header,
            width=size[0],
            height=size[1],
            distortion_model=name,
            d=np.array(d, float),
            k=K.ravel(),
            r=np.eye(3).ravel(),
            p=np.column_stack([K, np.zeros(3)]).ravel(),
            binning_x=0,
            binning_y=0,
            roi=self._make(
                "sensor_msgs/RegionOfInterest",
                x_offset=0,
                y_offset=0,
                height=0,
                width=0,
                do_rectify=False,
            ),
        )

    def diagnostics(
        self, header: Any, level: int, text: str, values: Sequence[tuple[str, str]]
    ) -> Any:
        """``diagnostic_msgs/DiagnosticArray`` with one status: 0 OK, 1 warning, 2 error."""
        status = self._make(
            "diagnostic_msgs/DiagnosticStatus",
            level=level,
            name="farpoint: camera motion",
            message=text,
            hardware_id="",
            values=[
                self._make("diagnostic_msgs/KeyValue", key=key, value=value)
                for key, value in values
            ],
        )
        return self._make("diagnostic_msgs/DiagnosticArray", header=header, status=[status])

    def _twist(self, twist: Twist) -> Any:
        velocity = self._make(
            "geometry_msgs/Twist",
            linear=self._vector(twist.linear),
            angular=self._vector(twist.angular),
        )
        name = "geometry_msgs/TwistWithCovariance"
        return self._make(name, twist=velocity, covariance=_flat(twist.covariance))

    def _vector(self, vector: np.ndarray) -> Any:
        return self._make("geometry_msgs/Vector3", **_xyz(vector))

    def _quaternion(self, R: np.ndarray) -> Any:
        numbers = map(float, so3.quat_xyzw_from_matrix(R))
        return self._make("geometry_msgs/Quaternion", **dict(zip("xyzw", numbers, strict=True)))

    def _make(self, kind: str, /, **fields: Any) -> Any:
        return self._store.types[kind.replace("/", "/msg/")](**fields)


def _xyz(vector: np.ndarray) -> dict[str, float]:
    return dict(zip("xyz", map(float, vector), strict=True))


def _flat(covariance: np.ndarray) -> np.ndarray:
    """The elements of a covariance row by row, made exactly symmetric."""
    return (0.5 * (covariance + covariance.T)).ravel()
