"""Capture of frames in a thread, with a buffer of one frame: the newest."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Self

from farpoint.frames.frame import Frame, FrameSource
from farpoint.frames.live.account import LiveAccount
from farpoint.frames.live.source import LiveSource

__all__ = ["Capture", "LiveFrame"]

_RETRY_S = 0.5
"""Time between two attempts to open a lost source, s."""
_FAREWELL_S = 2.0
"""Time that closing waits for a source that does not respond, s."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LiveFrame:
    """A frame with its time of arrival.

    Attributes
    ----------
    frame : Frame
        Frame with an image. The index counts the frames that the source delivered over all
        connections. Missing indices belong to dropped or broken frames.
    arrived_s : float
        Time of arrival on the monotonic clock, s.
    dropped : int
        Number of frames dropped since the previous call of `Capture.take` that returned a frame.
    """

    frame: Frame
    arrived_s: float
    dropped: int


class Capture:
    """Reader of a live source that never blocks the source and keeps only the newest frame.

    If the source is lost (a camera is unplugged, a stream breaks off), the reading thread tries
    twice a second to open the source again, until the source is open or the session ends. An object
    of this class is a context manager that stops the capture at the end of the block. A thread that
    still waits for the source 2 s after the stop is abandoned.

    Parameters
    ----------
    source : LiveSource
        Source, opened by the constructor, and opened again by the thread if the source is lost.

    Raises
    ------
    InputError
        If the constructor cannot open the source.
    """

    def __init__(self, source: LiveSource) -> None:
        self._source = source
        self._first: FrameSource | None = source.open()
        self.name = self._first.name
        """Short name of the source."""
        self.timestamp_source = self._first.timestamp_source
        """Origin of the time stamps, as text."""
        self.notes = self._first.notes
        """Notes about the images."""
        self.pixel_aspect: float = getattr(self._first, "pixel_aspect", 1.0)
        """Width of a pixel over its height."""
        self._changed = threading.Condition()
        self._account = LiveAccount()
        self._slot: LiveFrame | None = None
        self._last_arrival_s = time.monotonic()
        self._connected, self._ended = True, False
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, name="farpoint-capture", daemon=True)
        self._thread.start()

    @property
    def account(self) -> LiveAccount:
        """The counts so far."""
        with self._changed:
            waiting = int(self._slot is not None)
            silence_s = 0.0 if self._ended else self.silence_s
            longest_s = max(self._account.longest_silence_s, silence_s)
            return replace(self._account, waiting=waiting, longest_silence_s=longest_s)

    @property
    def silence_s(self) -> float:
        """Time since the last frame arrived, s."""
        return time.monotonic() - self._last_arrival_s

    @property
    def connected(self) -> bool:
        """Whether the source is open, even if no frames arrive."""
        return self._connected

    @property
    def ended(self) -> bool:
        """Whether the source has ended."""
        with self._changed:
            return self._ended and self._slot is None

    def take(self, timeout_s: float) -> LiveFrame | None:
        """Take the newest frame; None if no frame arrives in time."""
        with self._changed:
            self._wait(timeout_s)
            taken, self._slot = self._slot, None
            if taken is not None:
                self._account = replace(self._account, taken=self._account.taken + 1)
            return taken

    def peek(self, timeout_s: float) -> Frame | None:
        """Return the newest frame, which stays in the buffer; None if no frame arrives in time."""
        with self._changed:
            self._wait(timeout_s)
            return None if self._slot is None else self._slot.frame

    def close(self) -> None:
        """Stop; a waiting frame counts as dropped. A second call does nothing."""
        self._stop.set()
        self._thread.join(_FAREWELL_S)
        with self._changed:
            self._ended = True
            if self._slot is not None:
                self._slot = None
                self._account = replace(self._account, dropped=self._account.dropped + 1)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _wait(self, timeout_s: float) -> None:
        self._changed.wait_for(lambda: self._slot is not None or self._ended, timeout_s)

    def _work(self) -> None:
        source, self._first = self._first, None  # no reference may keep a lost device open
        try:
            while source is not None:
                fault = self._read(source)
                if self._stop.is_set() or (fault is None and not self._source.endless):
                    break
                self._lose(fault or "the source delivers no more frames")
                source = None  # some drivers open a device only once at a time
                source = self._open_again()
        finally:
            with self._changed:
                self._ended = True
                self._changed.notify_all()

    def _read(self, source: FrameSource) -> str | None:
        """Deliver frames until the source or the session ends; returns the fault of the source."""
        fault = None
        try:
            for frame in source:
                fault = frame.fault
                self._put(frame)
                if self._stop.is_set():
                    return None
        except Exception as error:  # any error of a driver counts as a lost source
            return f"{type(error).__name__}: {error}"
        return fault if self._source.endless else None

    def _put(self, frame: Frame) -> None:
        now_s = time.monotonic()
        with self._changed:
            if self._ended:  # `close` has abandoned this thread: the account is final
                return
            account, before = self._account, self._slot
            index, account = account.captured, replace(account, captured=account.captured + 1)
            if frame.image is None:  # does not replace a frame with an image
                self._account = replace(account, broken=account.broken + 1)
                return
            self._account = replace(
                account,
                dropped=account.dropped + int(before is not None),
                longest_silence_s=max(account.longest_silence_s, now_s - self._last_arrival_s),
            )
            self._slot = LiveFrame(
                frame=replace(frame, index=index),
                arrived_s=now_s,
                dropped=0 if before is None else before.dropped + 1,
            )
            self._last_arrival_s = now_s
            self._changed.notify_all()

    def _lose(self, fault: str) -> None:
        with self._changed:
            self._connected = False
            self._account = replace(
                self._account, disconnects=self._account.disconnects + 1, last_fault=fault
            )

    def _open_again(self) -> FrameSource | None:
        while not self._stop.wait(_RETRY_S):
            try:
                source = self._source.open()
            except Exception:  # drivers raise many kinds of errors
                continue
            with self._changed:
                self._connected = True
                self._account = replace(self._account, reconnects=self._account.reconnects + 1)
            return source
        return None
