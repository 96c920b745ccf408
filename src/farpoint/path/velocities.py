"""Velocities of the keyframes, from the poses of all frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from farpoint.geometry import so3
from farpoint.path.keyframe import Keyframe
from farpoint.path.prior import rotation_vectors
from farpoint.path.residuals import Poses

__all__ = [
    "KeyframeVelocities",
    "correct_velocities",
    "mean_velocity",
    "reset_linear_velocities",
    "velocity_between",
]


class _Unfinished(NamedTuple):
    """A keyframe whose velocity also depends on the next interval between frames.

    ``means`` (3, 6) holds the mean velocities over the last two intervals before the keyframe and
    over the interval after it.
    """

    keyframe: Keyframe
    means: np.ndarray


class KeyframeVelocities:
    """Velocities of keyframes, in the format of `Keyframe.twist`.

    The velocity at a keyframe is interpolated from mean velocities over four intervals between
    frames: two before the keyframe and two after it (`velocity_between`). Until the fourth interval
    is known, it is the mean of the velocities over the intervals before and after the keyframe.

    Attributes
    ----------
    last : ndarray, shape (6,)
        Mean velocity over the last interval; zero before the first interval.
    """

    def __init__(self) -> None:
        self.last = self._before = np.zeros(6)
        self._newest: Keyframe | None = None  # until the interval after it is known
        self._unfinished: _Unfinished | None = None

    def add_keyframe(self, keyframe: Keyframe) -> None:
        """Add a keyframe at the last pose."""
        self._newest = keyframe

    def add(self, mean: np.ndarray) -> None:
        """Add the mean velocity (6,) over the next interval between frames."""
        keyframe, self._newest = self._newest, None
        if self._unfinished is not None:
            previous, (before2, before, after) = self._unfinished
            previous.twist = velocity_between(before2, before, after, mean)
            self._unfinished = None
        if keyframe is not None:
            # Mean of the velocities over the intervals before and after the keyframe. For the first
            # keyframe, the velocity over the interval after the keyframe.
            is_first = not keyframe.twist.any()
            keyframe.twist = mean if is_first else 0.5 * (self.last + mean)
            if self._before.any():
                means = np.array([self._before, self.last, mean])
                self._unfinished = _Unfinished(keyframe, means)
        self.last, self._before = mean, self.last

    def correct(self, newest: Keyframe, before: dict[int, np.ndarray]) -> None:
        """Correct the mean velocities after the poses of the keyframes have changed.

        ``before`` holds the velocities of the keyframes before the change, by frame index. The
        change at the ``newest`` keyframe is added to the mean velocities of the last two intervals.
        """
        change = newest.twist - before[newest.frame]
        self.last, self._before = self.last + change, self._before + change
        if self._unfinished is not None:
            keyframe, means = self._unfinished
            change = keyframe.twist - before.get(keyframe.frame, keyframe.twist)
            self._unfinished = _Unfinished(keyframe, means + change)

    def restart(self, last: np.ndarray, before: np.ndarray) -> None:
        """Replace the mean velocities of the last two intervals."""
        self.last, self._before, self._unfinished = last, before, None

    def shift(self, rate: np.ndarray) -> None:
        """Add a velocity (6,), by which all poses have been changed, to the mean velocities."""
        self.restart(self.last + rate, self._before + rate)


def mean_velocity(
    before: tuple[np.ndarray, np.ndarray], now: tuple[np.ndarray, np.ndarray], seconds: float
) -> np.ndarray:
    """Mean velocity (6,) between two poses (R, p), ``seconds`` apart; zero if no time passes."""
    if not seconds > 0.0:
        return np.zeros(6)
    (R0, p0), (R1, p1) = before, now
    return np.concatenate([so3.log(R1 @ R0.T), p1 - p0]) / seconds


def velocity_between(
    before2: np.ndarray, before: np.ndarray, after: np.ndarray, after2: np.ndarray
) -> np.ndarray:
    """Velocity at a keyframe, from mean velocities over the two intervals before and two after.

    For intervals of equal length, the result is exact if the velocity is a polynomial of third
    degree in time. The mean of ``before`` and ``after`` alone would underestimate the extremes of
    an oscillating velocity. The estimated read-out time would then be too large, because the
    observed shear of the image is proportional to the product of velocity and read-out time.
    """
    return (7.0 * (before + after) - (before2 + after2)) / 12.0


def reset_linear_velocities(frames: Sequence[Keyframe]) -> None:
    """Set the linear velocities of keyframes to finite differences of their positions."""
    velocities = _rates(frames, np.array([frame.p for frame in frames]))
    for frame, velocity in zip(frames, velocities, strict=True):
        frame.twist = np.concatenate([frame.twist[:3], velocity])


def correct_velocities(frames: Sequence[Keyframe], start: Poses) -> None:
    """Add the rates of change of the pose corrections to the velocities of keyframes.

    The velocities were computed from frame poses before a solution of the window. The corrections
    are the changes of the keyframe poses by the solution. ``start`` holds the keyframe poses before
    the solution.
    """
    poses = Poses.of(frames)
    turns = rotation_vectors(poses.R @ start.R.transpose(0, 2, 1))
    changes = np.concatenate([turns, poses.p - start.p], axis=1)
    for frame, change in zip(frames, _rates(frames, changes), strict=True):
        frame.twist = frame.twist + change


def _rates(frames: Sequence[Keyframe], values: np.ndarray) -> np.ndarray:
    """Rates of change (K, ...), per s, of values (K, ...) of keyframes.

    The rates are finite differences between neighbouring keyframes (`numpy.gradient`). The rates
    are zero if the time stamps do not increase.
    """
    times = np.array([frame.timestamp for frame in frames])
    if len(times) < 2 or not (np.diff(times) > 0.0).all():
        return np.zeros_like(values)
    return np.gradient(values, times, axis=0)
