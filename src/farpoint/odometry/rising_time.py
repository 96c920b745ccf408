"""Monotonic time stamps."""

from __future__ import annotations

from farpoint.odometry.constants import FIRST_INTERVAL_S

__all__ = ["RisingTime"]


class RisingTime:
    """Shifts time stamps after a decrease, so that they never decrease.

    Concatenated recordings restart their time: frames after the decrease continue one frame
    interval after the last one.

    Attributes
    ----------
    falls : int
        Number of decreases.
    """

    def __init__(self) -> None:
        self.falls = 0
        self._shift_s, self._interval_s = 0.0, FIRST_INTERVAL_S
        self._last_s: float | None = None

    def update(self, timestamp: float) -> tuple[float, bool]:
        """The monotonic time stamp, s, and whether time has decreased before it."""
        seconds, last_s = timestamp + self._shift_s, self._last_s
        fell = last_s is not None and seconds < last_s
        if last_s is not None and fell:
            self.falls += 1
            self._shift_s += last_s + self._interval_s - seconds
            seconds = last_s + self._interval_s
        elif last_s is not None and seconds > last_s:
            self._interval_s = seconds - last_s
        self._last_s = seconds
        return seconds, fell
