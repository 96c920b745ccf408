"""A smooth path through given poses, and the measurements of an IMU on this path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from farpoint.errors import InputError
from farpoint.fusion import ImuNoise, ImuSteps, InertialState
from farpoint.fusion.models import GRAVITY
from farpoint.geometry import so3
from farpoint.trajectory.files import Trajectory

__all__ = ["InertialPath", "SimulatedImu"]


class InertialPath:
    """A path with continuous accelerations: splines through the poses of a trajectory.

    Parameters
    ----------
    trajectory : Trajectory
        ``world_from_body`` with time stamps; the world's z axis points up.
    knot_s : float
        Time between the knots of the splines, s. If every recorded pose were a knot, the simulated
        IMU would measure the second derivative of the noise of the poses. Knots at least 0.1 s
        apart avoid this error.
    """

    def __init__(self, trajectory: Trajectory, knot_s: float = 0.1) -> None:
        if trajectory.timestamps is None:
            raise InputError("expected time stamps", field="trajectory")
        stamps = trajectory.timestamps - trajectory.timestamps[0]
        knots = np.unique(np.searchsorted(stamps, np.arange(0.0, stamps[-1], knot_s)))
        if len(knots) < 4:
            raise InputError(f"expected at least 4 poses {knot_s} s apart", field="trajectory")
        poses = trajectory.world_from_body[knots]
        self.duration_s = float(stamps[knots[-1]])
        self._position = CubicSpline(stamps[knots], poses[:, :3, 3])
        self._attitude = RotationSpline(stamps[knots], Rotation.from_matrix(poses[:, :3, :3]))

    def pose(self, time_s: float) -> np.ndarray:
        """``world_from_body`` (4, 4) at a time, s after the start of the path."""
        pose = np.eye(4)
        pose[:3, :3] = self._attitude(time_s).as_matrix()
        pose[:3, 3] = self._position(time_s)
        return pose

    def velocity(self, time_s: float) -> np.ndarray:
        """Velocity (3,) in the world, m/s."""
        return self._position(time_s, 1)

    def measured(self, times_s: np.ndarray) -> ImuSteps:
        """Measurements of an ideal IMU in the N steps between N + 1 times.

        The times are in s after the start of the path.
        """
        dt = np.diff(times_s)[:, None]
        attitudes = self._attitude(times_s).as_matrix()
        gyro = so3.log(np.swapaxes(attitudes[:-1], 1, 2) @ attitudes[1:]) / dt
        middle = self._attitude(times_s[:-1] + 0.5 * dt[:, 0]).as_matrix()
        acceleration = np.diff(self._position(times_s, 1), axis=0) / dt
        accel = np.swapaxes(middle, 1, 2) @ (acceleration - GRAVITY)[..., None]
        return ImuSteps(gyro=gyro, accel=accel[..., 0], dt=dt[:, 0])


@dataclass(frozen=True, kw_only=True, eq=False)
class SimulatedImu:
    """Simulated measurements of an IMU on an `InertialPath`, and the true biases.

    Attributes
    ----------
    times_s : ndarray, shape (N + 1,)
        Times at which the steps begin and end, s.
    steps : ImuSteps
        Measurements with biases and noise.
    gyro_bias, accel_bias : ndarray, shape (N + 1, 3)
        True biases at the times.
    """

    times_s: np.ndarray
    steps: ImuSteps
    gyro_bias: np.ndarray
    accel_bias: np.ndarray

    @classmethod
    def on(
        cls,
        path: InertialPath,
        times_s: np.ndarray,
        noise: ImuNoise,
        *,
        gyro_bias: np.ndarray,
        accel_bias: np.ndarray,
        seed: int,
    ) -> SimulatedImu:
        """Simulate an IMU on a path, given the times, the initial biases and the seed."""
        rng = np.random.default_rng(seed)
        measured = path.measured(times_s)
        dt = measured.dt[:, None]

        def walk(start: np.ndarray, density: float) -> np.ndarray:
            steps = density * np.sqrt(dt) * rng.normal(size=measured.gyro.shape)
            return start + np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])

        def white(density: float) -> np.ndarray:
            return density / np.sqrt(dt) * rng.normal(size=measured.gyro.shape)

        gyro_biases = walk(gyro_bias, noise.gyro_walk)
        accel_biases = walk(accel_bias, noise.accel_walk)
        return cls(
            times_s=times_s,
            steps=ImuSteps(
                gyro=measured.gyro + gyro_biases[:-1] + white(noise.gyro_density),
                accel=measured.accel + accel_biases[:-1] + white(noise.accel_density),
                dt=measured.dt,
            ),
            gyro_bias=gyro_biases,
            accel_bias=accel_biases,
        )

    def true_state(self, path: InertialPath, step: int) -> InertialState:
        """The true state at the beginning of a step, as the state of a filter at an image."""
        time_s = float(self.times_s[step])
        return InertialState.at(
            path.pose(time_s)[:3, :3],
            path.velocity(time_s),
            self.gyro_bias[step],
            self.accel_bias[step],
        )
