"""When each image was taken: by its header, held against when it was recorded."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["HeaderClock"]

_CONTRADICTS_S = 3600.0
"""A header that departs by so much from the clock of the recording, and alone, is damaged."""

_FRAME_S = 0.1  # until two headers have told


@dataclass
class HeaderClock:
    """Follows the headers of a topic.

    The clock of the headers need not be that of the recording; but the difference of the two does
    not jump in one message and back in the next, except in damaged ones.
    """

    _offset_s: float | None = None  # of the headers to the recording's clock
    _other_s: float | None = None  # where the last header was refused
    _last_s: float | None = None
    _interval_s: float = _FRAME_S

    def take(self, stamp_ns: int, recorded_s: float | None) -> float | None:
        """Time of an image, s; None where its header contradicts those before."""
        stamp_s = stamp_ns / 10**9
        if not stamp_ns:  # never set
            stamp_s = self.guess(recorded_s) if recorded_s is None else recorded_s
        offset_s = stamp_s - (stamp_s if recorded_s is None else recorded_s)
        if self._offset_s is not None and abs(offset_s - self._offset_s) > _CONTRADICTS_S:
            other, self._other_s = self._other_s, offset_s
            if other is None or abs(offset_s - other) > _CONTRADICTS_S:
                return None  # the next one that agrees with it is believed
        self._offset_s, self._other_s = offset_s, None
        if self._last_s is not None and stamp_s > self._last_s:
            self._interval_s = stamp_s - self._last_s
        self._last_s = stamp_s
        return stamp_s

    def rewind(self) -> None:
        """Begin anew, with what was learned of the two clocks."""
        self._last_s = None

    def guess(self, recorded_s: float | None) -> float:
        """Time of an image whose header is lost, s: not before the one before."""
        if recorded_s is not None and self._offset_s is not None:
            time_s = recorded_s + self._offset_s
        elif self._last_s is not None:
            time_s = self._last_s + self._interval_s
        else:
            time_s = recorded_s or 0.0
        self._last_s = time_s if self._last_s is None else max(time_s, self._last_s)
        return self._last_s
