"""What every reader yields, and what every reader is."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

__all__ = ["Frame", "FrameSource"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """One image of a source, or the account of why it is missing.

    Attributes
    ----------
    index : int
        Position in the source, counted from 0; frames that cannot be decoded count too.
    timestamp : float
        Seconds.
    image : ndarray of uint8, shape (height, width), or None
        Grey values; None where the frame could not be decoded.
    fault : str or None
        Why `image` is None.
    name : str
        File name, or the frame's number in a video: what to call it to a person.
    time_ns : int or None
        Where the source counts in ns: what `timestamp` is the nearest float to.
    """

    index: int
    timestamp: float
    image: np.ndarray | None
    name: str
    fault: str | None = None
    time_ns: int | None = None


class FrameSource(Protocol):
    """A sequence of frames, decoded one at a time while it is iterated.

    Files and folders open nothing until they are iterated, close when the iteration ends or is
    abandoned, and can be iterated again. Cameras and streams are live: they are read once.
    """

    @property
    def name(self) -> str:
        """Short name of the source: names the output folder."""
        ...

    @property
    def count(self) -> int | None:
        """Number of frames where it is known in advance; for some videos an estimate."""
        ...

    @property
    def timestamp_source(self) -> str:
        """Where the time stamps come from, for a person: a file, the names, an assumed rate."""
        ...

    @property
    def calibration_path(self) -> Path | None:
        """A file next to the images that looks like their calibration; a hint, never used."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """What was done to the images that whoever uses the results must know."""
        ...

    def __iter__(self) -> Iterator[Frame]:
        """Frames from start to end."""
        ...
