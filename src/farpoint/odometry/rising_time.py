"""Time stamps that never fall, whatever a recording's own do."""

from __future__ import annotations

__all__ = ["RisingTime"]

_INTERVAL_S = 0.1
"""Between two frames where none has been seen yet (10 frames a second, as elsewhere)."""


class RisingTime:
    """Moves the time stamps behind a fall so that they follow the ones before it.

    Recordings joined one behind the other begin their time anew: what comes after the fall goes on
    one frame interval after what came before.

    Attributes
    ----------
    falls : int
        How often time has fallen.
    """

    def __init__(self) -> None:
        self.falls = 0
        self._shift_s, self._interval_s = 0.0, _INTERVAL_S
        self._last_s: float | None = None

    def follow(self, timestamp: float) -> tuple[float, bool]:
        """The time stamp as it goes on, s, and whether time has fallen before it."""
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
