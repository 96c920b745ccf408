"""Monotonic time stamps."""

from __future__ import annotations

from farpoint.odometry.constants import FIRST_INTERVAL_S

__all__ = ["RisingTime"]


class RisingTime:
    """Shifts time stamps that decrease, so that the shifted time stamps never decrease.

    In concatenated recordings the time restarts with each recording. The first frame of a later
    recording is placed one frame interval after the last frame of the recording before.

    Attributes
    ----------
    falls : int
        Number of time stamps below the previous time stamp.
    """

    def __init__(self) -> None:
        self.falls = 0
        self._shift_s, self._interval_s = 0.0, FIRST_INTERVAL_S
        self._last_s: float | None = None

    def update(self, timestamp: float) -> tuple[float, bool]:
        """The shifted time stamp, s, and whether ``timestamp`` decreased from the last frame."""
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
