"""Capture times of frames whose time stamps jitter."""

from __future__ import annotations

from collections import deque

import numpy as np

from farpoint.odometry.constants import (
    MAX_DEPARTURE_RATIO,
    MAX_INTERVAL_CORRELATION,
    MAX_INTERVAL_DEPARTURE,
    MAX_STAMPS,
    MIN_STAMPS,
    NO_JITTER,
)

__all__ = ["CaptureTimes"]


class CaptureTimes:
    """Capture times of a camera with a constant period, from time stamps of arrival.

    A time stamp can be the arrival time of a frame. Drivers and buses delay frames by some
    milliseconds, which changes velocities by 10 % and more. If the period is constant, the capture
    time is on a line over the frame number, which is fitted to the last 60 time stamps. The errors
    of the time stamps are then independent: the variance of an interval between two time stamps is
    twice the variance of a time stamp, and successive intervals have a correlation of -1/2. If the
    period varies, as on phones in changing light, the intervals are independent, and the time
    stamps drift away from the line. The time stamps are then used unchanged.
    """

    def __init__(self) -> None:
        self._stamps: deque[float] = deque(maxlen=MAX_STAMPS)
        self._last_s: float | None = None

    def restart(self) -> None:
        """Forget all frames: the next one is of another recording."""
        self._stamps.clear()
        self._last_s = None

    def update(self, timestamp: float) -> float:
        """Capture time of the next frame, s. Capture times increase if time stamps increase."""
        self._stamps.append(timestamp)
        seconds = self._on_line(np.array(self._stamps))
        if self._last_s is not None and seconds <= self._last_s:
            seconds = max(timestamp, self._last_s)
        self._last_s = seconds
        return seconds

    @staticmethod
    def _on_line(stamps: np.ndarray) -> float:
        """The last time stamp, moved onto the line through all stamps if the period is constant."""
        last, intervals = float(stamps[-1]), np.diff(stamps)
        period = float(np.median(intervals)) if len(intervals) > 1 else 0.0
        if not period > 0.0:
            return last
        counts = np.maximum(np.rint(intervals / period), 1.0)  # above 1 where frames are lost
        x = np.concatenate([[0.0], np.cumsum(counts)])
        x -= x.mean()
        period = float(x @ stamps / (x @ x))
        residuals, off = stamps - stamps.mean() - period * x, intervals - period * counts
        square = float(off @ off) / len(off)
        if (
            not (NO_JITTER * period) ** 2 < square
            or np.abs(off).max() > MAX_INTERVAL_DEPARTURE * period
        ):
            return last
        ratio = np.sqrt(residuals @ residuals / (len(x) - 2) / square)
        correlation = float(np.mean(off[1:] * off[:-1])) / square
        is_constant = ratio < MAX_DEPARTURE_RATIO and correlation < MAX_INTERVAL_CORRELATION
        if len(stamps) >= MIN_STAMPS and not is_constant:
            return last
        return last - float(residuals[-1])
