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
    """One image of a source, or a fault that explains why the image is missing.

    Attributes
    ----------
    index : int
        Position in the source, counted from 0 and including frames that cannot be decoded.
    timestamp : float
        Time of the frame, s.
    image : ndarray of uint8, shape (height, width), or None
        Grey values; None if the frame could not be decoded.
    fault : str or None
        Reason why `image` is None; None for a decoded image.
    name : str
        Name of the frame in messages: file name, or number of the frame in a video.
    time_ns : int or None
        Exact time, ns, if the source has times in ns; `timestamp` is the nearest float in seconds.
    """

    index: int
    timestamp: float
    image: np.ndarray | None
    name: str
    fault: str | None = None
    time_ns: int | None = None


class FrameSource(Protocol):
    """A sequence of frames, decoded one at a time during iteration.

    Files and folders are opened at the start of an iteration and closed at the end. Files and
    folders can be iterated repeatedly. Cameras and streams are live and can be iterated only once.
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
        """Origin of the time stamps, as text: a file, the file names, or an assumed frame rate."""
        ...

    @property
    def calibration_path(self) -> Path | None:
        """A file near the images that may be a calibration; for messages only."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes about changes of the images, for the user of the results."""
        ...

    def __iter__(self) -> Iterator[Frame]:
        """Frames from start to end."""
        ...
