"""Mean velocities of the camera between frames, and the prior of their changes."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from farpoint._kernels.constants import GATE_SIGMA
from farpoint.geometry import so3
from farpoint.odometry.constants import (
    ANGULAR_ACCELERATION,
    AVERAGED_CHANGES,
    DIRECTION_TURN_RATE,
)
from farpoint.pose import RelativePose
from farpoint.pose.shutter import VelocityPrior

__all__ = ["Velocities"]


class Velocities:
    """Mean velocities between successive frames, and how much they change.

    The directions of translation are those of the matches: opposite to the velocity of the camera.
    """

    def __init__(self) -> None:
        # In the axes of the last frame: the last two angular velocities, rad/s, and the direction
        # of the last translation.
        self._rates: list[np.ndarray] = []
        self._direction: np.ndarray | None = None
        # Squares of a coordinate of the change of the angular velocity, (rad/s)^2, of the change of
        # this change, and of the rate at which the direction turns.
        self._changes, self._curvatures, self._turns = _Squares(), _Squares(), _Squares()

    def add(self, motion: RelativePose, seconds: float) -> None:
        """Add the motion from the reference frame to the current frame, ``seconds`` later."""
        R, direction = motion.rotation_cam1_from_cam0, motion.direction_cam1_from_cam0
        if R is None or seconds <= 0.0:
            self.break_off()
            return
        rate, rates = so3.log(R) / seconds, [R @ each for each in self._rates]
        if len(rates) == 2:
            first, second = rate - rates[1], rate - 2.0 * rates[1] + rates[0]
            self._changes.add(float(first @ first) / 3.0)
            self._curvatures.add(float(second @ second) / 3.0)
        self._rates = [*rates[-1:], rate]
        if direction is not None and self._direction is not None:
            cosine = float(direction @ R @ self._direction)
            self._turns.add(0.5 * (math.acos(min(max(cosine, -1.0), 1.0)) / seconds) ** 2)
        self._direction = direction

    def break_off(self) -> None:
        """Forget the last velocities, because the next motion does not follow in time.

        The changes of earlier velocities are kept.
        """
        self._rates, self._direction = [], None

    def prior(self, seconds: float) -> VelocityPrior:
        """Prior for the next pair of frames, which are ``seconds`` apart.

        The prior assumes that the angular velocity is constant, or that it changes as between the
        last frames: the assumption that had the smaller error in the earlier frames. The errors of
        the angular velocity at an image are, by Taylor series, at most 1/2 of the first difference
        of mean angular velocities, and 1/3 of the second. The error of the change is 1/2 of the
        second difference.
        """
        turn_sigma = self._turns.sigma(DIRECTION_TURN_RATE) * seconds
        change = self._changes.sigma(ANGULAR_ACCELERATION * seconds) * seconds
        curvature = self._curvatures.sigma(math.inf) * seconds
        if not self._rates or change / 2.0 <= curvature / 3.0:
            return VelocityPrior(None, change, turn_sigma)
        return VelocityPrior(self._rates[-1] * seconds, 0.5 * curvature, turn_sigma)


class _Squares:
    """The last squares of a quantity. A square counts as at most 9 times the mean before it.

    A wrong motion therefore hardly increases the mean.
    """

    def __init__(self) -> None:
        self._squares: deque[float] = deque(maxlen=AVERAGED_CHANGES)

    def add(self, square: float) -> None:
        if self._squares:
            square = min(square, GATE_SIGMA**2 * float(np.mean(self._squares)))
        self._squares.append(square)

    def sigma(self, default: float) -> float:
        """Root of the mean square; ``default`` before the first square."""
        return math.sqrt(float(np.mean(self._squares))) if self._squares else default
