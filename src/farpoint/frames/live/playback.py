"""Playback of a recording at its frame rate as a live source, with simulated faults."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path

import numpy as np

from farpoint.errors import InputError
from farpoint.frames.frame import Frame

__all__ = ["Black", "Disconnect", "Fault", "Playback", "Stall"]


@dataclass(frozen=True, kw_only=True)
class Fault:
    """A simulated fault.

    Attributes
    ----------
    at_s, for_s : float
        Start, s since the first opening, and duration, s.
    """

    at_s: float
    for_s: float

    def holds(self, seconds: float) -> bool:
        """Whether the fault is active at a time."""
        return self.at_s <= seconds < self.at_s + self.for_s


class Stall(Fault):
    """The source sends no frames but stays connected."""


class Black(Fault):
    """The source sends black frames."""


class Disconnect(Fault):
    """The source is disconnected and cannot be opened."""


@dataclass(kw_only=True, eq=False)
class Playback:
    """Frames of a recording, delivered at their frame rate, with wall-clock time stamps.

    Parameters
    ----------
    frames : iterable of Frame
        The recording, which is iterated again for every loop.
    endless : bool
        Whether the end of the recording counts as a disconnection.
    loop : bool
        Whether to start the recording again at its end.
    faults : tuple of Fault
        Simulated faults of the source.

    Attributes
    ----------
    delivered, black : int
        Number of delivered frames, and number of black frames among these, for comparison with the
        counts of a session.
    """

    frames: Iterable[Frame]
    endless: bool = False
    loop: bool = False
    faults: tuple[Fault, ...] = ()
    delivered: int = field(default=0, init=False)
    black: int = field(default=0, init=False)
    _start_s: float | None = field(default=None, init=False)
    _rest: Iterator[tuple[Frame, float]] | None = field(default=None, init=False)

    name: str = field(default="playback", init=False)
    count: int | None = field(default=None, init=False)
    timestamp_source: str = field(default="wall clock", init=False)
    calibration_path: Path | None = field(default=None, init=False)
    notes: tuple[str, ...] = field(default=(), init=False)
    pixel_aspect: float = field(default=1.0, init=False)

    def __post_init__(self) -> None:
        for name in ("name", "notes", "pixel_aspect"):
            setattr(self, name, getattr(self.frames, name, getattr(self, name)))

    def open(self) -> Playback:
        """Start the clock at the first call; later calls continue the recording."""
        if self._start_s is None:
            self._start_s = time.monotonic()
            self._rest = self._paced()
        if self._suffers(Disconnect):
            raise InputError("the camera is unplugged", field="source")
        return self

    def __iter__(self) -> Iterator[Frame]:
        """Frames at their frame rate until the recording ends or the source is disconnected."""
        assert self._rest is not None
        due = time.monotonic()
        for frame, gap_s in self._rest:
            due = max(due + gap_s, time.monotonic() - gap_s)  # makes up one interval at most
            self._wait_until(due)
            while self._suffers(Stall):
                time.sleep(0.005)
            if self._suffers(Disconnect):
                return
            image = frame.image
            if image is not None and self._suffers(Black):
                image = np.zeros_like(image)
                self.black += 1
            self.delivered += 1
            yield replace(frame, image=image, timestamp=time.time())

    def _paced(self) -> Iterator[tuple[Frame, float]]:
        """Each frame with the time since the previous frame, s; endless if the playback loops."""
        gap_s = 0.0
        for _ in count() if self.loop else range(1):
            earlier_s = None
            for frame in self.frames:
                if earlier_s is not None:
                    gap_s = max(frame.timestamp - earlier_s, 0.0)
                earlier_s = frame.timestamp
                yield frame, gap_s

    def _wait_until(self, due_s: float) -> None:
        time.sleep(max(due_s - time.monotonic(), 0.0))

    def _suffers(self, kind: type[Fault]) -> bool:
        assert self._start_s is not None
        now_s = time.monotonic() - self._start_s
        return any(isinstance(fault, kind) and fault.holds(now_s) for fault in self.faults)
