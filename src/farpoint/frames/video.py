"""Video files, read by PyAV with their time stamps, even if damaged or of variable frame rate."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO, Any

from farpoint.errors import InputError, optional_import
from farpoint.frames.calibration import find_calibration
from farpoint.frames.depth import GreyTable
from farpoint.frames.frame import Frame
from farpoint.frames.packets import Moment, decode, frame_rate
from farpoint.frames.stamps import DEFAULT_FPS

_BEGINNING_BYTES = 4096
_PLAYLIST = re.compile(
    r"#extm3u|ffconcat version|<mpd[\s>]|\A\W{0,8}v=0\s|\A\W{0,8}\[reference\]|<smil[\s>]"
    r"|\A\W{0,8}\[playlist\]|\A\W{0,8}file\s+['\"]?\S|<compositionplaylist|\A\W{0,8}rtsptext"
)
"""Marks of playlists: HLS, ffconcat, DASH, SDP, ASX, SMIL, PLS, concat lists, IMF and RTSPtext."""

__all__ = ["VideoFile", "frame_count", "frames_of", "open_container", "open_video", "video_stream"]


@dataclass(frozen=True, kw_only=True)
class VideoFile:
    """A video file, decoded one picture at a time. The object can be iterated repeatedly.

    Time stamps are those in the container and are not shifted to zero. A picture without a time
    stamp follows the previous picture by the nominal frame interval.

    Attributes
    ----------
    path : Path
        The file.
    name : str
        File name without suffix.
    count : int or None
        Number of frames from the header, or from duration and frame rate; None if unknown.
    timestamp_source : str
        Origin of the time stamps: the container or the frame rate.
    nominal_fps : float
        Frame rate for pictures without a time stamp, 1/s.
    calibration_path : Path or None
        A file near the video that may be a calibration.
    pixel_aspect : float
        Width of a pixel divided by its height; 1 for square pixels.
    deep : GreyTable or None
        Table for samples of 16 bits, from the first picture; None for other videos.
    opener : callable or None
        Opens the file if the file is not on this machine.
    """

    path: Path
    name: str
    count: int | None
    timestamp_source: str
    nominal_fps: float
    calibration_path: Path | None = None
    pixel_aspect: float = 1.0
    deep: GreyTable | None = None
    opener: Callable[[], IO[bytes]] | None = None

    @property
    def notes(self) -> tuple[str, ...]:
        """A note about the mapping of samples of more than 8 bits to grey values, if necessary."""
        return (self.deep.words,) if self.deep is not None and self.deep.words else ()

    def __iter__(self) -> Iterator[Frame]:
        """Frames in order of time; an undecodable picture is a frame with a fault."""
        with self.container() as container:
            stream = video_stream(container, self.path)
            yield from frames_of(decode(container, stream, self.deep), self.nominal_fps)

    def container(self) -> AbstractContextManager[Any]:
        """A context with the file opened by PyAV."""
        return _open(self.path, self.opener)


def open_video(
    path: Path,
    *,
    fps: float | None,
    follow_playlists: bool = False,
    opener: Callable[[], IO[bytes]] | None = None,
) -> VideoFile:
    """Open a video, and check that there is at least one picture.

    Parameters
    ----------
    path : Path
        The file.
    fps : float or None
        Frames per second of a file without time stamps (a raw H.264 stream). None takes the frame
        rate in the header.
    follow_playlists : bool
        Open the files that are named in a playlist, in any folder.
    opener : callable, optional
        Opens the file if the file is not on this machine; ``path`` is then the name of the file.

    Raises
    ------
    InputError
        If the file is no video, or if no picture can be decoded.
    """
    if not follow_playlists and _is_playlist(opener or partial(path.open, "rb")):
        raise InputError(
            "is a playlist, which names other files; they are played if asked for "
            "(--follow-playlists)",
            file=path,
        )
    with _open(path, opener) as container:
        stream = video_stream(container, path)
        rate = fps or frame_rate(stream) or DEFAULT_FPS
        first = next((moment for moment in decode(container, stream) if not moment.fault), None)
        if first is None:
            raise InputError("holds no picture that can be decoded: truncated?", file=path)
        folder = path.absolute().parent
        return VideoFile(
            path=path,
            name=path.stem,
            count=frame_count(container, stream),
            timestamp_source="video" if first.seconds is not None else f"{rate:g} frames a second",
            nominal_fps=rate,
            calibration_path=find_calibration(folder, stem=path.stem),
            pixel_aspect=_pixel_aspect(stream, first),
            deep=first.deep,
            opener=opener,
        )


def frames_of(moments: Iterator[Moment], nominal_fps: float) -> Iterator[Frame]:
    """Frames from pictures and faults, with indices and with missing times filled in."""
    seconds = -1 / nominal_fps
    for index, moment in enumerate(moments):
        seconds = seconds + 1 / nominal_fps if moment.seconds is None else moment.seconds
        yield Frame(
            index=index,
            timestamp=seconds,
            image=moment.image,
            name=str(index),
            fault=moment.fault,
        )


def frame_count(container: Any, stream: Any) -> int | None:
    """Number of frames in the header of a stream, else duration times frame rate, else None."""
    if stream.frames > 0:
        return stream.frames
    rate = frame_rate(stream)
    if container.duration is None or rate is None:
        return None
    return round(container.duration / 1e6 * rate)  # duration is in us


def video_stream(container: Any, source: str | Path) -> Any:
    """The video stream of an open container; raises InputError if there is none."""
    av = optional_import("av", extra="video", purpose="reading video")
    stream = container.streams.best("video")
    # The cover of a piece of music is a video stream of one picture.
    if stream is None or stream.disposition & av.stream.Disposition.attached_pic:
        raise InputError("holds no video, only sound or data", file=source)
    return stream


def open_container(address: str | IO[bytes], **options: Any) -> Any:
    """Open a container by PyAV with PyAV's ``options``, even if the metadata is not UTF-8.

    PyAV before version 19 needs the additional option ``metadata_errors`` for such metadata.
    """
    av = optional_import("av", extra="video", purpose="reading video")
    if int(av.__version__.partition(".")[0]) < 19:
        options["metadata_errors"] = "replace"
    return av.open(address, **options)


def _pixel_aspect(stream: Any, first: Moment) -> float:
    """Width of a pixel divided by its height in the upright pictures; 1 if unknown."""
    ratio = float(stream.sample_aspect_ratio or 1)
    if first.image is not None and first.image.shape == (stream.width, stream.height):
        ratio = 1.0 / ratio if stream.width != stream.height else ratio
    return ratio if ratio > 0.0 else 1.0


def _is_playlist(opener: Callable[[], IO[bytes]]) -> bool:
    """Whether the first bytes of a file show a playlist for FFmpeg."""
    with opener() as file:
        begin = file.read(_BEGINNING_BYTES)
    # A playlist is text; FFmpeg looks for its marks behind white space and byte order marks, too.
    text = begin.replace(b"\0", b"").lower().decode("latin-1")
    return bool(_PLAYLIST.search(text))


@contextmanager
def _open(path: Path, opener: Callable[[], IO[bytes]] | None = None) -> Iterator[Any]:
    av = optional_import("av", extra="video", purpose="reading video")
    with nullcontext() if opener is None else opener() as file:
        try:
            # "file:" keeps FFmpeg from taking the part of a name before a colon for a protocol.
            container = open_container(file or f"file:{path}")
        except av.FFmpegError as error:
            raise InputError(
                f"cannot be opened as a video, it may be truncated or of another kind "
                f"({error.strerror})",
                file=path,
            ) from error
        with container:
            # FFmpeg opens also a text (format tty) and a single image (formats _pipe) as a video.
            if container.format.name == "tty" or container.format.name.endswith("_pipe"):
                raise InputError("is a text or one image: expected a video", file=path)
            yield container
