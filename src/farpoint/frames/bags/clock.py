"""Times of images from headers, checked against the times of recording."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["HeaderClock"]

_CONTRADICTS_NS = 3600 * 10**9
"""Change of the offset of the header clock, ns, from which a single header counts as damaged."""

_ABOUT_ZERO_NS = 10**9
_FRAME_NS = 10**8  # frame interval until two headers are read


@dataclass
class HeaderClock:
    """Times of images, ns, from the headers of a topic.

    The clock of the headers may differ from the clock of the recording. If the difference jumps at
    one message and jumps back at the next message, the header of the first of the two is damaged.

    Attributes
    ----------
    offset_ns : int or None
        Offset of the header clock from the recording clock; None if either clock has no times.
    """

    offset_ns: int | None = None
    _other_ns: int | None = None  # offset of the last header, if it was refused
    _last_ns: int | None = None
    _interval_ns: int = _FRAME_NS

    @classmethod
    def of_first(cls, first: Sequence[tuple[int, int | None]]) -> HeaderClock:
        """Clock from the header times and the recording times of some messages."""
        offsets = [stamp - recorded for stamp, recorded in first if stamp and recorded is not None]
        return cls(statistics.median_low(offsets) if 2 * len(offsets) >= len(first) > 0 else None)

    def take(self, stamp_ns: int, recorded_ns: int | None) -> int | None:
        """Time of an image; None if the header contradicts earlier headers."""
        if not stamp_ns and not self._begins_at_zero(recorded_ns):  # never set
            return self.guess(recorded_ns)
        if recorded_ns is not None:
            offset_ns = stamp_ns - recorded_ns
            if self.offset_ns is not None and abs(offset_ns - self.offset_ns) > _CONTRADICTS_NS:
                other, self._other_ns = self._other_ns, offset_ns
                if other is None or abs(offset_ns - other) > _CONTRADICTS_NS:
                    return None  # the next header that agrees with it is accepted
            self.offset_ns, self._other_ns = offset_ns, None
        if self._last_ns is not None and stamp_ns > self._last_ns:
            self._interval_ns = stamp_ns - self._last_ns
        self._last_ns = stamp_ns
        return stamp_ns

    def _begins_at_zero(self, recorded_ns: int | None) -> bool:
        """Whether a time of 0 is valid: the header clock is near 0, and all times so far were 0."""
        if self.offset_ns is None or recorded_ns is None or self._last_ns:
            return False
        return abs(recorded_ns + self.offset_ns) < _ABOUT_ZERO_NS

    def guess(self, recorded_ns: int | None) -> int:
        """Time of an image whose header has no time or is lost; never before the previous image."""
        if recorded_ns is not None:
            time_ns = recorded_ns + (self.offset_ns or 0)
        elif self._last_ns is not None:
            time_ns = self._last_ns + self._interval_ns
        else:
            time_ns = 0
        self._last_ns = time_ns if self._last_ns is None else max(time_ns, self._last_ns)
        return self._last_ns
