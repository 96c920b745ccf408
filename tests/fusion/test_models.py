"""The filter's models: they retrace a known path, and their errors mean what they are said to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fusion_kit import (
    BODY_FROM_CAM,
    SEEN,
    fly,
    seen_pose,
    turned_only,
    uncertain_start,
    winding_path,
)

from farpoint.errors import InputError
from farpoint.fusion import ImuNoise, InertialState
from farpoint.fusion.models import central_differences, motion_error, predicted_motion, propagated
from farpoint.fusion.state import ERROR_SIZE, difference, retract
from farpoint.geometry import so3, sphere
from farpoint.synthetic import InertialPath, SimulatedImu
from farpoint.trajectory.files import Trajectory

TINY = ImuNoise(gyro_density=1e-12, gyro_walk=1e-12, accel_density=1e-12, accel_walk=1e-12)


def some_state(seed: int) -> InertialState:
    rng = np.random.default_rng(seed)
    return InertialState(
        world_from_body=so3.exp(rng.normal(size=3)),
        velocity=rng.normal(size=3),
        gyro_bias=0.1 * rng.normal(size=3),
        accel_bias=0.1 * rng.normal(size=3),
        displacement=rng.normal(size=3),
        last_world_from_body=so3.exp(rng.normal(size=3)),
    )


def test_a_perfect_imu_retraces_the_path():
    path, times = winding_path(), np.arange(0.0, 3.0, 0.005)
    bias = np.array([0.01, -0.02, 0.03])
    imu = SimulatedImu.on(path, times, TINY, gyro_bias=bias, accel_bias=10.0 * bias, seed=0)
    end = propagated(imu.true_state(path, 0), imu.steps)
    truth = imu.true_state(path, len(times) - 1)
    np.testing.assert_allclose(difference(truth, end)[:6], 0.0, atol=2e-4)
    travelled = path.pose(times[-1])[:3, 3] - path.pose(times[0])[:3, 3]
    np.testing.assert_allclose(end.displacement, travelled, atol=2e-4)


def test_the_imus_noise_is_as_large_as_its_density_says():
    path, times = winding_path(), np.arange(0.0, 10.0, 0.005)
    noise = ImuNoise(gyro_density=0.01, gyro_walk=1e-9, accel_density=0.2, accel_walk=1e-9)
    imu = SimulatedImu.on(path, times, noise, gyro_bias=np.zeros(3), accel_bias=np.zeros(3), seed=1)
    perfect = path.measured(times)
    for noisy, clean, density in (
        (imu.steps.gyro, perfect.gyro, 0.01),
        (imu.steps.accel, perfect.accel, 0.2),
    ):
        assert np.std(noisy - clean) == pytest.approx(density / np.sqrt(0.005), rel=0.03)


def test_a_path_needs_times_and_poses():
    with pytest.raises(InputError, match=r"^trajectory: expected time stamps"):
        InertialPath(Trajectory(timestamps=None, world_from_body=np.tile(np.eye(4), (9, 1, 1))))
    few = Trajectory(timestamps=np.arange(3.0), world_from_body=np.tile(np.eye(4), (3, 1, 1)))
    with pytest.raises(InputError, match=r"^trajectory: expected at least 4 poses"):
        InertialPath(few)


@pytest.mark.parametrize("seed", range(3))
def test_error_and_state_are_inverses(seed: int):
    state, rng = some_state(seed), np.random.default_rng(seed)
    errors = 0.3 * rng.normal(size=(5, ERROR_SIZE))
    np.testing.assert_allclose(difference(retract(state, errors), state), errors, atol=1e-12)


def test_the_state_predicts_the_motion_that_the_camera_makes():
    flight = fly(winding_path(), seed=3)
    here = propagated(flight.start, flight.steps[0])
    R, t = predicted_motion(here, BODY_FROM_CAM)
    R_true, t_true = flight.motions[0]
    assert so3.angle_between(R, R_true) < 1e-3
    np.testing.assert_allclose(t, t_true, atol=2e-4)


def test_the_motion_error_of_the_truth_is_the_error_of_the_pose():
    flight, rng = fly(winding_path(), seed=3), np.random.default_rng(4)
    R_true, t_true = flight.motions[5]
    # The world has the axes of camera 1, which is the body.
    state = replace(
        InertialState.at(np.eye(3), np.zeros(3)), displacement=-t_true, last_world_from_body=R_true
    )
    errors = []
    for _ in range(2000):
        pose = seen_pose(R_true, t_true, rng)
        error = motion_error(state, pose, np.eye(4))
        assert sphere.angle_between(pose.direction_cam1_from_cam0, sphere.normalize(t_true)) < 0.1
        errors.append(error)
        np.testing.assert_array_equal(motion_error(state, turned_only(pose), np.eye(4)), error[:3])
    found = np.mean(np.einsum("ni,nj->nij", errors, errors), axis=0)
    whitened = found / np.sqrt(np.outer(np.diag(SEEN), np.diag(SEEN)))
    np.testing.assert_allclose(whitened, np.eye(5), atol=0.12)


def test_the_motion_error_has_the_sides_and_signs_of_the_poses_covariance():
    pose = seen_pose(*fly(winding_path(), seed=3).motions[5], np.random.default_rng(5))
    R, d, B = pose.rotation_cam1_from_cam0, pose.direction_cam1_from_cam0, pose.direction_basis
    error = np.array([0.01, -0.02, 0.03, 1e-5, -2e-5])
    # The world has the axes of camera 1, which is the body.
    state = replace(
        InertialState.at(np.eye(3), np.zeros(3)),
        displacement=-0.2 * sphere.retract(d, B, error[3:]),
        last_world_from_body=so3.exp(error[:3]) @ R,
    )
    np.testing.assert_allclose(motion_error(state, pose, np.eye(4)), error, rtol=1e-8)


@pytest.mark.parametrize("seed", range(3))
def test_the_heading_on_the_map_is_the_same_unknown_at_every_state(seed: int):
    """Turning the world about the vertical changes nothing that is felt or seen."""
    flight = fly(winding_path(), seed=seed)
    start = uncertain_start(flight.start, seed)
    rotation = np.zeros(ERROR_SIZE)
    rotation[[2, 17]] = 0.7
    here, turned = (
        propagated(state, flight.steps[0]) for state in (start, retract(start, rotation))
    )
    np.testing.assert_allclose(difference(turned, here), rotation, atol=1e-12)
    pose = seen_pose(*flight.motions[0], np.random.default_rng(seed))
    np.testing.assert_allclose(
        motion_error(turned, pose, BODY_FROM_CAM),
        motion_error(here, pose, BODY_FROM_CAM),
        atol=1e-12,
    )


def test_a_state_that_moves_the_other_way_is_half_a_turn_off():
    flight = fly(winding_path(), seed=3)
    R_true, t_true = flight.motions[5]
    pose = seen_pose(R_true, t_true, np.random.default_rng(0))
    for off, expected in ((1.0, np.pi), (-1.0, 0.0)):
        state = replace(
            InertialState.at(np.eye(3), np.zeros(3)),
            displacement=off * pose.direction_cam1_from_cam0 + 1e-9,
            last_world_from_body=R_true,
        )
        across = motion_error(state, pose, np.eye(4))[3:]
        assert np.linalg.norm(across) == pytest.approx(expected, abs=1e-6)


def test_derivatives_of_a_known_function():
    A = np.random.default_rng(0).normal(size=(2, 3))
    found = central_differences(lambda steps: np.sin(steps) @ A.T, 3)
    np.testing.assert_allclose(found, A, atol=1e-9)


@pytest.mark.parametrize(
    "accel", [(0.0, 0.0, 9.8), (9.0, 0.1, -3.7), (0.0, 9.8, 0.0), (0.0, 0.0, -9.8)]
)
def test_a_body_at_rest_is_level(accel: tuple[float, float, float]):
    state = InertialState.at_rest(np.array(accel))
    up = state.world_from_body @ sphere.normalize(np.array(accel))
    np.testing.assert_allclose(up, [0.0, 0.0, 1.0], atol=1e-12)
