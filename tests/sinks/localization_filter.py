"""An extended Kalman filter of the form of ROS's ``robot_localization``: its state, its update.

T. Moore and D. Stouch, "A Generalized Extended Kalman Filter Implementation for the Robot Operating
System", 2014: 15 states (position, roll, pitch and yaw, velocity and angular velocity in the body,
acceleration in the body), an omnidirectional motion with constant acceleration, and measurements of
any of the states.
"""

from __future__ import annotations

import numpy as np

from farpoint.geometry import so3

POSITION, ANGLES, LINEAR, ANGULAR = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)

PROCESS_NOISE = np.diag(
    [0.05, 0.05, 0.06, 0.03, 0.03, 0.06, 0.025, 0.025, 0.04, 0.01, 0.01, 0.02, 0.01, 0.01, 0.015]
)
"""Its default, per second."""


def rotation(angles: np.ndarray) -> np.ndarray:
    """Of roll, pitch, yaw: about fixed X, then Y, then Z."""
    x, y, z = np.diag(angles)
    return so3.exp(z) @ so3.exp(y) @ so3.exp(x)


def predict(state: np.ndarray, seconds: float) -> np.ndarray:
    """Where the motion leads."""
    roll, pitch, _ = state[ANGLES]
    rates = np.array(
        [
            [1.0, np.sin(roll) * np.tan(pitch), np.cos(roll) * np.tan(pitch)],
            [0.0, np.cos(roll), -np.sin(roll)],
            [0.0, np.sin(roll) / np.cos(pitch), np.cos(roll) / np.cos(pitch)],
        ]
    )
    acceleration = state[12:15]
    after = state.copy()
    way = state[LINEAR] * seconds + 0.5 * acceleration * seconds**2
    after[POSITION] = state[POSITION] + rotation(state[ANGLES]) @ way
    after[ANGLES] = state[ANGLES] + rates @ state[ANGULAR] * seconds
    after[LINEAR] = state[LINEAR] + acceleration * seconds
    return after


class LocalizationFilter:
    """State (15,) and covariance (15, 15).

    Parameters
    ----------
    process_noise : ndarray, shape (15, 15)
        Per second.
    """

    def __init__(self, process_noise: np.ndarray = PROCESS_NOISE) -> None:
        self.state = np.zeros(15)
        self.covariance = np.diag([1e-9] * 6 + [1e3] * 6 + [1.0] * 3)
        self._noise = process_noise

    def advance(self, seconds: float) -> None:
        """Predict."""
        h = 1e-6
        F = np.column_stack(
            [
                (predict(self.state + h * unit, seconds) - predict(self.state - h * unit, seconds))
                / (2 * h)
                for unit in np.eye(15)
            ]
        )
        self.state = predict(self.state, seconds)
        self.covariance = F @ self.covariance @ F.T + self._noise * seconds

    def update(self, states: slice, measured: np.ndarray, covariance: np.ndarray) -> float:
        """Correct by a measurement of some states; the normalised square of its innovation."""
        H = np.eye(15)[states]
        innovation = measured - self.state[states]
        S = H @ self.covariance @ H.T + covariance
        K = np.linalg.solve(S, H @ self.covariance).T
        self.state = self.state + K @ innovation
        IKH = np.eye(15) - K @ H
        self.covariance = IKH @ self.covariance @ IKH.T + K @ covariance @ K.T  # Joseph's form
        return float(innovation @ np.linalg.solve(S, innovation))
