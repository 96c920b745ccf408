"""Mean angular velocity of the camera, and its prior for the correction of a rolling shutter."""

from __future__ import annotations

from collections import deque

import numpy as np

from farpoint.geometry import so3
from farpoint.odometry.constants import AVERAGED_CHANGES
from farpoint.pose import RelativePose
from farpoint.pose.shutter import AngularVelocityPrior

__all__ = ["AngularVelocity"]


class AngularVelocity:
    """Mean angular velocities between successive frames, and errors of their extrapolation."""

    def __init__(self) -> None:
        self._rates: list[np.ndarray] = []  # the last two, rad/s, in the axes of the last frame
        self._squares: deque[tuple[float, float]] = deque(maxlen=AVERAGED_CHANGES)

    def add(self, motion: RelativePose, seconds: float) -> None:
        """Add the motion from the reference frame to the current frame, ``seconds`` later."""
        R = motion.rotation_cam1_from_cam0
        if R is None or seconds <= 0.0:
            self.break_off()
            return
        rate, rates = so3.log(R) / seconds, [R @ each for each in self._rates]
        if len(rates) == 2:
            first, second = rate - rates[1], rate - 2.0 * rates[1] + rates[0]
            self._squares.append((float(first @ first) / 3.0, float(second @ second) / 3.0))
        self._rates = [*rates[-1:], rate]

    def break_off(self) -> None:
        """Forget the last angular velocities, because the next motion does not follow in time.

        The errors of earlier extrapolations are kept.
        """
        self._rates = []

    def prior(self, seconds: float) -> AngularVelocityPrior | None:
        """Prior for the next pair of frames, which are ``seconds`` apart; None at the beginning.

        The prior assumes that the angular velocity is constant, or that it is linear in time: the
        assumption that had the smaller error in the earlier frames.
        """
        if not self._rates or not self._squares:
            return None
        change, curvature = np.sqrt(np.mean(self._squares, axis=0)) * seconds
        linear = AngularVelocityPrior(before=self._rates[-1] * seconds, sigma=float(curvature))
        constant = AngularVelocityPrior(before=None, sigma=float(change))
        return min(linear, constant, key=AngularVelocityPrior.largest_error)
