"""State of the filter: attitude, velocity, biases, and displacement since the last image.

Errors of attitude, velocity and displacement are defined as in the right-invariant filter (Barrau
and Bonnabel, "The Invariant Extended Kalman Filter as a Stable Observer", IEEE TAC 62(4), 2017,
doi:10.1109/TAC.2016.2594085): an error of the attitude rotates velocity and displacement, too. An
error of the unobservable heading is then the same error vector at every state. Linearisation at
different states therefore adds no spurious information on the heading.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint.geometry import so3, sphere

__all__ = [
    "ACCEL_BIAS",
    "ATTITUDE",
    "DISPLACEMENT",
    "ERROR_SIZE",
    "GYRO_BIAS",
    "KNOWN",
    "LAST_ATTITUDE",
    "VELOCITY",
    "InertialState",
    "difference",
    "retract",
]

ATTITUDE, VELOCITY, GYRO_BIAS, ACCEL_BIAS = (slice(k, k + 3) for k in (0, 3, 6, 9))
DISPLACEMENT, LAST_ATTITUDE = slice(12, 15), slice(15, 18)
KNOWN = slice(0, 12)
ERROR_SIZE = 18
"""Number of components of the error: 12 of attitude, velocity and biases, then 6 of displacement
and last attitude, which the next update needs."""


@dataclass(frozen=True, kw_only=True, eq=False)
class InertialState:
    """State of a body with an IMU, in a world whose z axis points up.

    Arrays with leading axes hold a stack of states.

    Attributes
    ----------
    world_from_body : ndarray, shape (..., 3, 3)
        Attitude of the IMU.
    velocity : ndarray, shape (..., 3)
        Velocity of the IMU in the world, m/s.
    gyro_bias : ndarray, shape (..., 3)
        Bias of the gyroscope, rad/s.
    accel_bias : ndarray, shape (..., 3)
        Bias of the accelerometer, m/s^2.
    displacement : ndarray, shape (..., 3)
        Displacement of the IMU since the last image, in the world, m.
    last_world_from_body : ndarray, shape (..., 3, 3)
        Attitude of the IMU at the last image.
    """

    world_from_body: np.ndarray
    velocity: np.ndarray
    gyro_bias: np.ndarray
    accel_bias: np.ndarray
    displacement: np.ndarray
    last_world_from_body: np.ndarray

    @classmethod
    def at(
        cls,
        world_from_body: np.ndarray,
        velocity: np.ndarray,
        gyro_bias: np.ndarray | None = None,
        accel_bias: np.ndarray | None = None,
    ) -> InertialState:
        """State at an image; biases are 0 unless given."""
        return cls(
            world_from_body=world_from_body,
            velocity=velocity,
            gyro_bias=np.zeros(3) if gyro_bias is None else gyro_bias,
            accel_bias=np.zeros(3) if accel_bias is None else accel_bias,
            displacement=np.zeros(3),
            last_world_from_body=world_from_body,
        )

    @classmethod
    def at_rest(cls, accel: np.ndarray) -> InertialState:
        """State of a body at rest that measures the specific force ``accel`` (3,), m/s^2.

        The heading is 0. A bias of the accelerometer causes an error of the tilt of 0.1 rad per
        m/s^2.
        """
        up = np.array([0.0, 0.0, 1.0])
        axis = np.cross(accel, up)
        sine = float(np.linalg.norm(axis))
        if sine == 0.0:  # upright or upside down: the horizontal axis is arbitrary
            axis, sine = np.array([1.0, 0.0, 0.0]), 1.0
        angle = sphere.angle_between(sphere.normalize(accel), up)
        return cls.at(so3.exp(float(angle) * axis / sine), np.zeros(3))

    @property
    def velocity_body(self) -> np.ndarray:
        """Velocity in the body's own axes, m/s, shape (..., 3)."""
        return _rotate(np.swapaxes(self.world_from_body, -1, -2), self.velocity)


def retract(state: InertialState, error: np.ndarray) -> InertialState:
    """The true state, from an estimate and the error (..., 18) of this estimate.

    Attitude and velocity are ``R_true = Exp(dtheta) @ R`` and ``v_true = Exp(dtheta) @ v + dv``.
    The displacement changes like the velocity, with the same ``dtheta``. The errors of the biases
    are added to the biases. The attitude at the last image changes like the attitude, with another
    ``dtheta``.
    """
    rotation, last_rotation = so3.exp(error[..., ATTITUDE]), so3.exp(error[..., LAST_ATTITUDE])
    return InertialState(
        world_from_body=rotation @ state.world_from_body,
        velocity=_rotate(rotation, state.velocity) + error[..., VELOCITY],
        gyro_bias=state.gyro_bias + error[..., GYRO_BIAS],
        accel_bias=state.accel_bias + error[..., ACCEL_BIAS],
        displacement=_rotate(rotation, state.displacement) + error[..., DISPLACEMENT],
        last_world_from_body=last_rotation @ state.last_world_from_body,
    )


def difference(truth: InertialState, estimate: InertialState) -> np.ndarray:
    """The error (..., 18) with which `retract` maps the estimate to the truth."""
    rotation = truth.world_from_body @ np.swapaxes(estimate.world_from_body, -1, -2)
    last_rotation = truth.last_world_from_body @ np.swapaxes(estimate.last_world_from_body, -1, -2)
    return np.concatenate(
        [
            so3.log(rotation),
            truth.velocity - _rotate(rotation, estimate.velocity),
            truth.gyro_bias - estimate.gyro_bias,
            truth.accel_bias - estimate.accel_bias,
            truth.displacement - _rotate(rotation, estimate.displacement),
            so3.log(last_rotation),
        ],
        axis=-1,
    )


def _rotate(R: np.ndarray, v: np.ndarray) -> np.ndarray:
    return (R @ v[..., None])[..., 0]
