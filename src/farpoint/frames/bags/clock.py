"""When each image was taken: by its header, held against when it was recorded."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["HeaderClock"]

_CONTRADICTS_NS = 3600 * 10**9
"""A header that departs by so much from the clock of the recording, and alone, is damaged."""

_ABOUT_ZERO_NS = 10**9
_FRAME_NS = 10**8  # until two headers are read


@dataclass
class HeaderClock:
    """Follows the headers of a topic; all times in ns.

    The clock of the headers need not be that of the recording; but the difference of the two does
    not jump in one message and back in the next, except in damaged ones.

    Attributes
    ----------
    offset_ns : int or None
        From the recording's clock to that of the headers; None where one of them has no time.
    """

    offset_ns: int | None = None
    _other_ns: int | None = None  # where the last header was refused
    _last_ns: int | None = None
    _interval_ns: int = _FRAME_NS

    @classmethod
    def of_first(cls, first: Sequence[tuple[int, int | None]]) -> HeaderClock:
        """By the headers of some messages, and when these were recorded."""
        offsets = [stamp - recorded for stamp, recorded in first if stamp and recorded is not None]
        return cls(statistics.median_low(offsets) if 2 * len(offsets) >= len(first) > 0 else None)

    def take(self, stamp_ns: int, recorded_ns: int | None) -> int | None:
        """Time of an image; None where its header contradicts those before."""
        if not stamp_ns and not self._begins_at_zero(recorded_ns):  # never set
            return self.guess(recorded_ns)
        if recorded_ns is not None:
            offset_ns = stamp_ns - recorded_ns
            if self.offset_ns is not None and abs(offset_ns - self.offset_ns) > _CONTRADICTS_NS:
                other, self._other_ns = self._other_ns, offset_ns
                if other is None or abs(offset_ns - other) > _CONTRADICTS_NS:
                    return None  # the next one that agrees with it is believed
            self.offset_ns, self._other_ns = offset_ns, None
        if self._last_ns is not None and stamp_ns > self._last_ns:
            self._interval_ns = stamp_ns - self._last_ns
        self._last_ns = stamp_ns
        return stamp_ns

    def _begins_at_zero(self, recorded_ns: int | None) -> bool:
        """Whether the headers' clock was about zero at that time, and has not gone on since."""
        if self.offset_ns is None or recorded_ns is None or self._last_ns:
            return False
        return abs(recorded_ns + self.offset_ns) < _ABOUT_ZERO_NS

    def guess(self, recorded_ns: int | None) -> int:
        """Time of an image whose header has none or is lost: not before the one before."""
        if recorded_ns is not None:
            time_ns = recorded_ns + (self.offset_ns or 0)
        elif self._last_ns is not None:
            time_ns = self._last_ns + self._interval_ns
        else:
            time_ns = 0
        self._last_ns = time_ns if self._last_ns is None else max(time_ns, self._last_ns)
        return self._last_ns
