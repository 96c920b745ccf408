"""Frames, and the interface of sources of frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

__all__ = ["Frame", "FrameSource"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """One image of a source, or a missing image with its fault.

    Attributes
    ----------
    index : int
        Position in the source, counted from 0; frames that cannot be decoded count too.
    timestamp : float
        Seconds.
    image : ndarray of uint8, shape (height, width), or None
        Grey values; None where the frame could not be decoded.
    fault : str or None
        Reason why `image` is None.
    name : str
        Name in messages: file name, or number of the frame in a video.
    time_ns : int or None
        Exact time if the source has times in ns; `timestamp` is the nearest float, s.
    """

    index: int
    timestamp: float
    image: np.ndarray | None
    name: str
    fault: str | None = None
    time_ns: int | None = None


class FrameSource(Protocol):
    """A sequence of frames, decoded one at a time while it is iterated.

    Files and folders are opened at the start of an iteration, closed at its end, and can be
    iterated again. Cameras and streams are live and can be iterated once.
    """

    @property
    def name(self) -> str:
        """Short name of the source and of the output folder."""
        ...

    @property
    def count(self) -> int | None:
        """Number of frames if known in advance, otherwise None; for some videos an estimate."""
        ...

    @property
    def timestamp_source(self) -> str:
        """Origin of the time stamps, as text: a file, the names, an assumed rate."""
        ...

    @property
    def calibration_path(self) -> Path | None:
        """A file near the images that may be their calibration; for messages only."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes about changes of the images, for the user of the results."""
        ...

    def __iter__(self) -> Iterator[Frame]:
        """Frames from start to end."""
        ...
