"""Progress on standard error: number of finished frames, frames per second, time left."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Self, TextIO

__all__ = ["Progress"]

_TERMINAL_S = 0.2
_LOG_S = 5.0
_LONGEST_S = 30 * 86400.0  # a longer time left comes from a wrong number of frames in the file


class Progress:
    """A progress line, updated in place on a terminal, else printed anew every few seconds.

    Parameters
    ----------
    what : str
        Name of the counted objects, such as ``"frames"``.
    total : int or None
        Expected number of objects, from which the time left is computed; None if unknown.
    stream : TextIO, optional
        Output stream; standard error by default.
    """

    def __init__(self, what: str, total: int | None, stream: TextIO | None = None) -> None:
        self._what, self._total = what, total
        self._stream = stream or sys.stderr
        self._terminal = self._stream.isatty()
        self._done, self._note = 0, ""
        self._shown_any = False
        self._start = self._last_shown = time.monotonic()

    def step(self) -> None:
        """Count one more finished object."""
        self.reach(self._done + 1)

    def reach(self, done: int, note: str = "") -> None:
        """Set the number of finished objects, and show ``note`` beside the number."""
        self._done, self._note = done, note
        now = time.monotonic()
        if now - self._last_shown >= (_TERMINAL_S if self._terminal else _LOG_S):
            self._last_shown = now
            self._show(now)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Show the final count, but not after an error, so that the error message comes last."""
        if not isinstance(error, Exception):  # an end or Ctrl-C
            self._show(time.monotonic())
        if self._terminal and self._shown_any:
            print(file=self._stream)

    def _show(self, now: float) -> None:
        self._shown_any = True
        rate = self._done / max(now - self._start, 1e-9)
        of = "" if self._total is None else f"/{self._total}"
        text = f"{self._done}{of} {self._what}, {rate:.1f}/s"
        if self._total is not None and 0 < self._done < self._total:
            left_s = (self._total - self._done) / rate
            # No time left is printed if the total is from a damaged header.
            text += f", {_duration(left_s)} left" if left_s < _LONGEST_S else ""
        text += f", {self._note}" if self._note else ""
        if self._terminal:
            print(f"\r\x1b[K{text}", end="", file=self._stream, flush=True)
        else:
            print(text, file=self._stream, flush=True)


def _duration(seconds: float) -> str:
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours}:{minutes:02d} h"
    return f"{minutes}:{seconds:02d} min" if minutes else f"{seconds} s"
