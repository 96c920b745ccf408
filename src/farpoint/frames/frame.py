"""What every reader yields, and what every reader is."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
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
    """

    index: int
    timestamp: float
    image: np.ndarray | None
    name: str
    fault: str | None = None


class FrameSource(Protocol):
    """A sequence of frames that is read once, from start to end.

    Attributes
    ----------
    name : str
        Short name of the source: names the output folder.
    count : int or None
        Number of frames if it is known in advance.
    """

    name: str
    count: int | None

    def __iter__(self) -> Iterator[Frame]: ...
