"""When each image was taken: by its header, held against when it was recorded."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["HeaderClock"]

_CONTRADICTS_S = 3600.0
"""A header that departs by so much from the clock of the recording, and alone, is damaged."""

_ABOUT_ZERO_S = 1.0
_FRAME_S = 0.1  # until two headers have told


@dataclass
class HeaderClock:
    """Follows the headers of a topic.

    The clock of the headers need not be that of the recording; but the difference of the two does
    not jump in one message and back in the next, except in damaged ones.

    Attributes
    ----------
    offset_s : float or None
        From the recording's clock to that of the headers, s; None where one of them has no time.
    """

    offset_s: float | None = None
    _other_s: float | None = None  # where the last header was refused
    _last_s: float | None = None
    _interval_s: float = _FRAME_S

    @classmethod
    def of_first(cls, first: Sequence[tuple[int, float | None]]) -> HeaderClock:
        """By the headers, ns, of some messages, and when these were recorded, s."""
        offsets = [
            stamp_ns / 10**9 - time_s
            for stamp_ns, time_s in first
            if stamp_ns and time_s is not None
        ]
        return cls(statistics.median(offsets) if 2 * len(offsets) >= len(first) > 0 else None)

    def take(self, stamp_ns: int, recorded_s: float | None) -> float | None:
        """Time of an image, s; None where its header contradicts those before."""
        if not stamp_ns and not self._begins_at_zero(recorded_s):  # never set
            return self.guess(recorded_s)
        stamp_s = stamp_ns / 10**9
        if recorded_s is not None:
            offset_s = stamp_s - recorded_s
            if self.offset_s is not None and abs(offset_s - self.offset_s) > _CONTRADICTS_S:
                other, self._other_s = self._other_s, offset_s
                if other is None or abs(offset_s - other) > _CONTRADICTS_S:
                    return None  # the next one that agrees with it is believed
            self.offset_s, self._other_s = offset_s, None
        if self._last_s is not None and stamp_s > self._last_s:
            self._interval_s = stamp_s - self._last_s
        self._last_s = stamp_s
        return stamp_s

    def _begins_at_zero(self, recorded_s: float | None) -> bool:
        """Whether the headers' clock was about zero at that time, and has not gone on since."""
        if self.offset_s is None or recorded_s is None or self._last_s:
            return False
        return abs(recorded_s + self.offset_s) < _ABOUT_ZERO_S

    def guess(self, recorded_s: float | None) -> float:
        """Time of an image whose header has none or is lost, s: not before the one before."""
        if recorded_s is not None:
            time_s = recorded_s + (self.offset_s or 0.0)
        elif self._last_s is not None:
            time_s = self._last_s + self._interval_s
        else:
            time_s = 0.0
        self._last_s = time_s if self._last_s is None else max(time_s, self._last_s)
        return self._last_s
