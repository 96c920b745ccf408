"""Process and measurement model of the filter.

Both models are plain functions of states, which may be stacked. The derivatives of the models are
central differences.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from farpoint.fusion.imu import ImuSteps
from farpoint.fusion.state import InertialState
from farpoint.geometry import so3
from farpoint.pose import RelativePose

__all__ = ["GRAVITY", "central_differences", "motion_error", "predicted_motion", "propagated"]

GRAVITY = np.array([0.0, 0.0, -9.81])
"""Acceleration of free fall in the world, m/s^2, which varies by 0.25 % between places on Earth."""

_STEP = 1e-5


def central_differences(function: Callable[[np.ndarray], np.ndarray], size: int) -> np.ndarray:
    """Derivative (M, size) at 0 of a function that takes stacked steps (2 * size, size)."""
    values = function(np.concatenate([_STEP * np.eye(size), -_STEP * np.eye(size)]))
    return ((values[:size] - values[size:]) / (2.0 * _STEP)).T


def propagated(state: InertialState, steps: ImuSteps) -> InertialState:
    """State propagated by IMU measurements, which are corrected by the biases of the state."""
    # Midpoint attitude: the error is of order dt^3.
    half_rotations = so3.exp(0.5 * steps.dt[:, None] * (steps.gyro - state.gyro_bias[..., None, :]))
    forces = steps.accel - state.accel_bias[..., None, :]
    R, v, p = state.world_from_body, state.velocity, state.displacement
    for k, dt in enumerate(steps.dt):
        middle = R @ half_rotations[..., k, :, :]
        acceleration = (middle @ forces[..., k, :, None])[..., 0] + GRAVITY
        p = p + dt * v + 0.5 * dt**2 * acceleration
        v = v + dt * acceleration
        R = middle @ half_rotations[..., k, :, :]
    return replace(state, world_from_body=R, velocity=v, displacement=p)


def predicted_motion(
    state: InertialState, body_from_cam: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (..., 3, 3) and translation (..., 3), m, ``cam1_from_cam0``, since the last image.

    Parameters
    ----------
    state : InertialState
        Current state, at camera 1. The displacement and the last attitude give the pose of camera
        0.
    body_from_cam : ndarray, shape (4, 4)
        Pose of the camera on the body.
    """
    cam1_from_world = np.swapaxes(state.world_from_body @ body_from_cam[:3, :3], -1, -2)
    world_from_cam0 = state.last_world_from_body @ body_from_cam[:3, :3]
    lever = (state.world_from_body - state.last_world_from_body) @ body_from_cam[:3, 3]
    travel = state.displacement + lever
    return cam1_from_world @ world_from_cam0, -(cam1_from_world @ travel[..., None])[..., 0]


def motion_error(state: InertialState, pose: RelativePose, body_from_cam: np.ndarray) -> np.ndarray:
    """Error ``[dtheta, dbeta]`` (..., 5), rad, of the measured motion if ``state`` is true.

    The components are defined as in the covariance of ``pose``, except that the length of ``dbeta``
    is the angle between the directions and not the tangent of this angle. ``dbeta`` is therefore
    finite for a state that moves in the opposite direction. If the pose has no direction, the
    result is only ``dtheta`` (..., 3).
    """
    R_measured, d, B = (
        pose.rotation_cam1_from_cam0,
        pose.direction_cam1_from_cam0,
        pose.direction_basis,
    )
    assert R_measured is not None
    R, t = predicted_motion(state, body_from_cam)
    dtheta = so3.log(R @ R_measured.T)
    if d is None or B is None:
        return dtheta
    across = t @ B
    size = np.linalg.norm(across, axis=-1, keepdims=True)
    angle = np.arctan2(size, (t @ d)[..., None])
    return np.concatenate([dtheta, across * (angle / np.maximum(size, 1e-300))], axis=-1)
