"""A real IMU beside a real camera, and paths that people and drones really took."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from fusion_kit import fly, fused

import farpoint as fp
from farpoint.fusion import (
    ImuNoise,
    InertialFilter,
    InertialState,
    StartSigmas,
    read_euroc_imu,
)
from farpoint.geometry import so3
from farpoint.synthetic import InertialPath
from farpoint.trajectory.files import Trajectory

EUROC_GYRO_BIAS = np.array([-0.00224703, 0.0215352, 0.0770299])
"""rad/s, from the batch solution over the whole flight that comes with the data."""


RUNNING_MOTORS = ImuNoise(gyro_density=7e-3, accel_density=0.1)
"""They shake the IMU forty times as much as its data sheet says: 0.1 rad/s from step to step."""


def test_a_camera_finds_the_bias_of_a_real_gyroscope(shared_data: Path):
    """The helicopter stands on the floor and starts its motors."""
    folder = shared_data / "euroc_v101_micro"
    sensor = (folder / "calib" / "cam0_sensor.yaml").read_text().removeprefix("%YAML:1.0")
    body_from_cam = np.reshape(yaml.safe_load(sensor)["T_BS"]["data"], (4, 4))
    imu = read_euroc_imu(folder / "imu0.csv")
    start = InertialState.at_rest(imu.accel[:10].mean(axis=0))
    sigmas = StartSigmas(gyro_bias=0.1, velocity=0.05)
    both, blind = (InertialFilter(start, sigmas, RUNNING_MOTORS, body_from_cam) for _ in range(2))
    camera = fp.load_camera(folder / "calib" / "cam0_sensor.yaml")
    for result in fp.Odometry(camera).run(fp.open_frames(folder / "images")):
        if result.pose is not None:
            steps = imu.between(result.timestamp0, result.timestamp)
            both.predict(steps)
            blind.predict(steps)
            both.update(result.pose)
    np.testing.assert_allclose(both.state.gyro_bias, EUROC_GYRO_BIAS, atol=0.003)
    true_turn = turn_in_truth(folder / "groundtruth_openvins_V1_01_easy.csv")
    turned = [start.world_from_body.T @ f.state.world_from_body for f in (both, blind)]
    off = np.rad2deg([so3.angle_between(R, true_turn) for R in turned])
    assert off[0] < 0.15
    assert off[1] > 4.0  # the bias alone turns it so far in 1.2 s
    assert np.linalg.norm(both.state.velocity) < 0.1


def turn_in_truth(file: Path, images: int = 25) -> np.ndarray:
    """``body0_from_body1`` over the images that are there."""
    w, *xyz = np.loadtxt(file, delimiter=",", comments="#", usecols=range(4, 8)).T
    attitudes = so3.matrix_from_quat_xyzw(np.column_stack([*xyz, w])[[0, images - 1]])
    return attitudes[0].T @ attitudes[1]


def real_path(file: Path, begin_s: float, seconds: float) -> InertialPath:
    rows = np.loadtxt(file, comments="#", usecols=range(8))
    rows = rows[
        (rows[:, 0] >= rows[0, 0] + begin_s) & (rows[:, 0] <= rows[0, 0] + begin_s + seconds)
    ]
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, :3] = so3.matrix_from_quat_xyzw(rows[:, 4:])
    poses[:, :3, 3] = rows[:, 1:4]
    return InertialPath(Trajectory(timestamps=rows[:, 0], world_from_body=poses))


@pytest.mark.parametrize(
    ("name", "begin_s"),
    [("dataset-room2_512_16.txt", 20.0), ("indoor_forward_7_snapdragon_with_gt.txt", 30.0)],
)
def test_handheld_and_racing_motions(shared_data: Path, name: str, begin_s: float):
    path = real_path(shared_data / "trajectories" / name, begin_s, seconds=8.0)
    nees, nis = [], []
    for seed in range(6):
        flight = fly(path, seed, begin_s=0.5 * seed)
        images = list(fused(flight, seed))
        nis += [innovation.nis for _, innovation, _ in images]
        filter_, _, truth = images[-1]
        nees.append(filter_.nees(truth))
    assert np.mean(nis) == pytest.approx(5.0, abs=4.0 * np.sqrt(10.0 / len(nis)))
    assert 6.0 < np.mean(nees) < 19.0  # by chance 999 times in 1000
