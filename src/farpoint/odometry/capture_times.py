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
    """Capture times of frames: time stamps without jitter, if the camera has a constant period.

    A time stamp may be the arrival time of a frame. Drivers and buses delay frames by some
    milliseconds, and such an error changes a velocity by 10 % and more. If the period is constant,
    the capture time is linear in the frame number. The line is fitted to the last 60 time stamps,
    and the value of the line replaces the time stamp. If the period varies, as on phones in
    changing light, the time stamps are used unchanged.

    Two statistics show whether the period is constant. With a constant period, the errors of the
    time stamps are independent: the variance of an interval is twice the variance of a time stamp,
    and successive intervals have a correlation of -1/2. With a varying period, the intervals are
    uncorrelated, and the time stamps drift away from the line.
    """

    def __init__(self) -> None:
        self._stamps: deque[float] = deque(maxlen=MAX_STAMPS)
        self._last_s: float | None = None

    def restart(self) -> None:
        """Forget all frames, because the next frame belongs to another recording."""
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
        """Value of the fitted line at the last frame; the last time stamp for a varying period."""
        last, intervals = float(stamps[-1]), np.diff(stamps)
        period = float(np.median(intervals)) if len(intervals) > 1 else 0.0
        if not period > 0.0:
            return last
        counts = np.maximum(np.rint(intervals / period), 1.0)  # periods; above 1 for lost frames
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
