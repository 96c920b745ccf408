"""An IMU out of a bag."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bags_kit import RECORDED_NS, Sent, header, write_bag

from farpoint.errors import InputError
from farpoint.fusion import read_bag_imu


def samples(count: int) -> list[Sent]:
    return [
        Sent(
            "/imu",
            "sensor_msgs/msg/Imu",
            RECORDED_NS + k,
            {
                "header": header(10**9 + 5_000_000 * k, "imu"),
                "orientation": dict.fromkeys("xyzw", 0.0),
                "orientation_covariance": np.zeros(9),
                "angular_velocity": {"x": 0.1 * k, "y": 0.2, "z": 0.3},
                "angular_velocity_covariance": np.zeros(9),
                "linear_acceleration": {"x": 1.0, "y": 2.0, "z": 9.81},
                "linear_acceleration_covariance": np.zeros(9),
            },
        )
        for k in range(count)
    ]


def test_samples_are_those_of_the_topic(tmp_path: Path):
    path = write_bag(
        tmp_path, "ros1", samples(10), damage=lambda k, data: data[:50] if k == 4 else data
    )
    imu = read_bag_imu(path, "/imu")
    kept = [k for k in range(10) if k != 4]
    np.testing.assert_allclose(imu.timestamps, [1.0 + 0.005 * k for k in kept])
    np.testing.assert_allclose(imu.gyro[:, 0], [0.1 * k for k in kept])
    np.testing.assert_allclose(imu.accel, np.tile([1.0, 2.0, 9.81], (9, 1)))


def test_a_topic_that_is_not_there_is_named(tmp_path: Path):
    path = write_bag(tmp_path, "mcap", samples(3))
    with pytest.raises(InputError, match=r"no topic /nowhere; expected one of /imu \(3\)"):
        read_bag_imu(path, "/nowhere")
