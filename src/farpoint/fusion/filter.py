"""Error-state Kalman filter that fuses an IMU with two-view motions and their covariances."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from farpoint.errors import InputError
from farpoint.fusion.imu import ImuNoise, ImuSteps
from farpoint.fusion.models import central_differences, motion_error, propagated
from farpoint.fusion.state import (
    ACCEL_BIAS,
    ATTITUDE,
    DISPLACEMENT,
    ERROR_SIZE,
    GYRO_BIAS,
    KNOWN,
    LAST_ATTITUDE,
    VELOCITY,
    InertialState,
    difference,
    retract,
)
from farpoint.geometry import sphere
from farpoint.metrics import chi2_quantile
from farpoint.pose import RelativePose

__all__ = ["InertialFilter", "Innovation", "StartSigmas"]

_STEPS_AT_ONCE = 20  # largest number of IMU steps in one Jacobian: each adds 6 columns for noise


@dataclass(frozen=True, kw_only=True)
class StartSigmas:
    """1-sigma of the initial state, per axis.

    Attributes
    ----------
    tilt_rad, heading_rad : float
        Attitude about the horizontal axes (tilt), and about the vertical axis (heading). The
        heading is unobservable: its initial value is arbitrary, and its 1-sigma may be small.
    velocity : float
        Velocity, m/s. If this 1-sigma is above about 0.33 times the speed, the covariance of the
        speed is too small after the first updates.
    gyro_bias : float
        Bias of the gyroscope, rad/s.
    accel_bias : float
        Bias of the accelerometer, m/s^2.
    """

    tilt_rad: float = 0.02
    heading_rad: float = 1e-3
    velocity: float = 0.2
    gyro_bias: float = 0.02
    accel_bias: float = 0.1

    def covariance(self) -> np.ndarray:
        """Covariance (18, 18) of the error of the initial state, at the time of an image.

        The attitude at the last image equals the current attitude, and the displacement is 0.
        """
        sigmas = np.zeros(ERROR_SIZE)
        sigmas[ATTITUDE] = (self.tilt_rad, self.tilt_rad, self.heading_rad)
        sigmas[VELOCITY] = self.velocity
        sigmas[GYRO_BIAS] = self.gyro_bias
        sigmas[ACCEL_BIAS] = self.accel_bias
        return _at_an_image(np.diag(sigmas**2))


@dataclass(frozen=True, kw_only=True)
class Innovation:
    """Innovation of a two-view motion.

    Attributes
    ----------
    dof : int
        Degrees of freedom: 5 for rotation and direction, 3 for rotation alone, 0 without a
        measurement.
    nis : float
        Normalised innovation squared. For a consistent filter the mean is `dof`.
    used : bool
        False if the gate rejected the motion, or if there was no measurement.
    """

    dof: int
    nis: float
    used: bool


class InertialFilter:
    """Estimates attitude, velocity and IMU biases of a body that carries an IMU and a camera.

    The camera measures the rotation between two images and the direction of travel, each with its
    covariance. The measured rotations make the gyroscope's bias observable. The measured changes of
    direction under the accelerations that the IMU measures make the speed observable.

    Parameters
    ----------
    state : InertialState
        State at the time of the first image.
    start : StartSigmas
        1-sigma of the errors of ``state``.
    noise : ImuNoise
        Noise of the IMU.
    body_from_cam : ndarray, shape (4, 4)
        Pose of the camera on the IMU (Kalibr's and EuRoC's ``T_BS`` of the camera).
    gate : float
        Probability of the chi-square gate on innovations. With 1, no innovation is rejected.

    Attributes
    ----------
    state : InertialState
        Current estimate.
    covariance : ndarray, shape (18, 18)
        Covariance of the error of ``state``, in the order of `farpoint.fusion.state`.

    Examples
    --------
    >>> for result in odometry.run(frames):  # doctest: +SKIP
    ...     if result.pose is not None:
    ...         fused.predict(imu.between(result.timestamp0, result.timestamp))
    ...         fused.update(result.pose)
    """

    def __init__(
        self,
        state: InertialState,
        start: StartSigmas,
        noise: ImuNoise,
        body_from_cam: np.ndarray,
        *,
        gate: float = 0.9999,
    ) -> None:
        if np.shape(body_from_cam) != (4, 4):
            raise InputError("expected a 4x4 matrix", field="body_from_cam")
        if not 0.0 < gate <= 1.0:
            raise InputError(f"expected a probability, got {gate}", field="gate")
        self.state, self.covariance = state, start.covariance()
        self._noise, self._body_from_cam, self._gate = noise, np.asarray(body_from_cam), gate

    def predict(self, steps: ImuSteps) -> None:
        """Propagate the state and its covariance by IMU measurements."""
        for part in steps.parts(_STEPS_AT_ONCE):
            self._propagate(part)

    def _propagate(self, steps: ImuSteps) -> None:
        state, count = propagated(self.state, steps), len(steps)

        def error_after(step: np.ndarray) -> np.ndarray:
            before = retract(self.state, step[:, :ERROR_SIZE])
            noise = step[:, ERROR_SIZE:].reshape(-1, 2, count, 3)
            measured = ImuSteps(
                gyro=steps.gyro + noise[:, 0], accel=steps.accel + noise[:, 1], dt=steps.dt
            )
            return difference(propagated(before, measured), state)

        jacobian = central_differences(error_after, ERROR_SIZE + 6 * count)
        by_state, by_noise = np.hsplit(jacobian, [ERROR_SIZE])
        n = self._noise
        density = np.repeat([n.gyro_density, n.accel_density], 3 * count)
        variance = density**2 / np.tile(np.repeat(steps.dt, 3), 2)
        covariance = by_state @ self.covariance @ by_state.T + (by_noise * variance) @ by_noise.T
        for part, walk in ((GYRO_BIAS, n.gyro_walk), (ACCEL_BIAS, n.accel_walk)):
            covariance[part, part] += walk**2 * steps.dt.sum() * np.eye(3)
        self.state, self.covariance = state, covariance

    def update(self, pose: RelativePose) -> Innovation:
        """Update the filter with the motion since the last image, and start the next interval.

        The update uses the quantities that the pose contains: rotation and direction, rotation
        alone, or none. The displacement becomes 0, and the current attitude becomes the attitude at
        the last image.
        """
        innovation = self._correct(pose)
        self.state = InertialState.at(
            self.state.world_from_body,
            self.state.velocity,
            self.state.gyro_bias,
            self.state.accel_bias,
        )
        self.covariance = _at_an_image(self.covariance)
        return innovation

    def travel_direction(self) -> tuple[np.ndarray, np.ndarray]:
        """Direction of travel in the body's axes, a unit vector (3,), and its covariance (3, 3).

        The result is meaningless if the speed is not significantly above 0.
        """

        def direction(step: np.ndarray) -> np.ndarray:
            return sphere.normalize(retract(self.state, step).velocity_body)

        jacobian = central_differences(direction, ERROR_SIZE)
        return direction(np.zeros(ERROR_SIZE)), jacobian @ self.covariance @ jacobian.T

    def nees(self, truth: InertialState) -> float:
        """NEES of attitude, velocity and biases; 12 on average for a consistent filter."""
        error = difference(truth, self.state)[KNOWN]
        return float(error @ np.linalg.solve(self.covariance[KNOWN, KNOWN], error))

    def _correct(self, pose: RelativePose) -> Innovation:
        noise = pose.covariance if pose.covariance is not None else pose.rotation_covariance
        if noise is None:
            return Innovation(dof=0, nis=0.0, used=False)

        def error_measured(step: np.ndarray) -> np.ndarray:
            return motion_error(retract(self.state, step), pose, self._body_from_cam)

        # The error of the state is root @ x with the prior x ~ N(0, I), because the covariance is
        # singular and has no inverse.
        root = _square_root(self.covariance)
        white = np.linalg.inv(np.linalg.cholesky(noise))

        def misfit(x: np.ndarray) -> np.ndarray:
            return np.concatenate([x, white @ error_measured(root @ x)])

        def slope(x: np.ndarray) -> np.ndarray:
            return np.vstack(
                [np.eye(ERROR_SIZE), white @ _derivative(error_measured, root @ x) @ root]
            )

        # The update is iterated to the maximum of the posterior (Bell and Cathey, IEEE TAC 38(2),
        # 1993, doi:10.1109/9.250476), because the direction is not linear in the velocity over the
        # range of an uncertain velocity.
        start: Any = np.zeros(ERROR_SIZE), slope  # SciPy's types know no callable derivative
        best = least_squares(misfit, *start, method="lm")
        dof, nis = len(noise), 2.0 * float(best.cost)
        if nis > chi2_quantile(self._gate, dof):
            return Innovation(dof=dof, nis=nis, used=False)
        step, found = root @ best.x, retract(self.state, root @ best.x)
        # The new covariance is that of the error of the new state, not of the predicted state.
        carry = _derivative(lambda steps: difference(retract(self.state, steps), found), step)
        carried = carry @ root
        self.covariance = carried @ np.linalg.inv(best.jac.T @ best.jac) @ carried.T
        self.state = found
        return Innovation(dof=dof, nis=nis, used=True)


def _derivative(function: Callable[[np.ndarray], np.ndarray], at: np.ndarray) -> np.ndarray:
    return central_differences(lambda steps: function(at + steps), len(at))


def _square_root(covariance: np.ndarray) -> np.ndarray:
    """A matrix ``root`` with ``root @ root.T`` equal to the covariance, which may be singular."""
    variances, axes = np.linalg.eigh(covariance)
    return axes * np.sqrt(np.maximum(variances, 0.0))


def _at_an_image(covariance: np.ndarray) -> np.ndarray:
    """The covariance (18, 18) at the time of an image, at which the next interval starts.

    The displacement is 0 without error. The attitude at the last image equals the current attitude.
    """
    carry = np.eye(ERROR_SIZE)
    carry[DISPLACEMENT] = carry[LAST_ATTITUDE] = 0.0
    carry[LAST_ATTITUDE, ATTITUDE] = np.eye(3)
    return carry @ covariance @ carry.T
