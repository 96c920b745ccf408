"""Live sources: cameras, streams, and recordings played at their frame rate."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from farpoint.frames.decode import MAX_MEGAPIXELS
from farpoint.frames.frame import FrameSource
from farpoint.frames.live.playback import Playback
from farpoint.frames.opening import open_frames

__all__ = ["LiveSource", "open_live"]


class LiveSource(Protocol):
    """A source that can be opened again after it was lost."""

    @property
    def endless(self) -> bool:
        """Whether the end of the source is a fault (an unplugged camera), not a recording's end."""
        ...

    def open(self) -> FrameSource:
        """Open the source, or open the source again.

        Raises
        ------
        InputError
            If the source cannot be opened now.
        """
        ...


@dataclass(kw_only=True, eq=False)
class Device:
    """A camera or a stream, given by a camera index or a URL.

    Parameters
    ----------
    source : str
        Source, as in `open_frames`.
    max_megapixels, follow_playlists
        Limits, as in `open_frames`.

    Attributes
    ----------
    endless : bool
        Whether the source has no end; False after `open` has found a recording at a URL.
    """

    source: str
    max_megapixels: float = MAX_MEGAPIXELS
    follow_playlists: bool = False
    endless: bool = field(default=True, init=False)

    def open(self) -> FrameSource:
        """Open the source; a recording is played at its frame rate."""
        frames = open_frames(
            self.source,
            max_megapixels=self.max_megapixels,
            follow_playlists=self.follow_playlists,
        )
        if frames.timestamp_source == "wall clock":
            return frames
        self.endless = False
        return Playback(frames=frames).open()


def open_live(
    source: str,
    *,
    loop: bool = False,
    max_megapixels: float = MAX_MEGAPIXELS,
    follow_playlists: bool = False,
) -> LiveSource:
    """Open a camera index or a URL; a file, folder or pattern is played at its frame rate.

    Parameters
    ----------
    source : str
        Source, as in `open_frames`.
    loop : bool
        Repeat a file or folder endlessly.
    max_megapixels, follow_playlists
        Limits, as in `open_frames`.
    """
    is_camera = source.isascii() and source.isdecimal() and not Path(source).exists()
    if is_camera or "://" in source:
        return Device(
            source=source, max_megapixels=max_megapixels, follow_playlists=follow_playlists
        )
    frames = open_frames(source, max_megapixels=max_megapixels, follow_playlists=follow_playlists)
    return Playback(frames=frames, loop=loop)
