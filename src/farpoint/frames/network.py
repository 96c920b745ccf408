"""Streams and recordings at a URL, read by PyAV."""

from __future__ import annotations

import http.client
import re
import shutil
import tempfile
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any
from urllib.parse import urlsplit

from farpoint.errors import InputError, optional_import
from farpoint.frames.frame import Frame
from farpoint.frames.packets import Moment, decode, frame_rate
from farpoint.frames.stamps import DEFAULT_FPS
from farpoint.frames.video import frame_count, frames_of, open_container, video_stream

__all__ = ["NetworkVideo", "in_wall_clock", "open_url"]

_SCHEMES = ("rtsp", "rtsps", "rtmp", "http", "https", "udp", "tcp", "rtp", "srt")
_LARGEST_COPY_BYTES = 1 << 32
"""Size limit of a recording from a server without byte ranges (convention)."""

_TIMEOUT_S = 10.0
"""Longest silence of a server, s, after which it counts as lost."""


@dataclass(frozen=True, kw_only=True, eq=False)
class NetworkVideo:
    """An open video at a URL, which can be iterated once.

    A live stream has wall-clock time stamps. The time stamp of the first picture is the time of
    arrival. Later time stamps follow the clock of the sender, which network delays do not affect. A
    recording of known duration has the time stamps of the recording, like a file.
    """

    name: str
    count: int | None
    timestamp_source: str
    container: Any
    stream: Any
    copy: IO[bytes] | None = None
    calibration_path: Path | None = None
    notes: tuple[str, ...] = ()

    def __iter__(self) -> Iterator[Frame]:
        """Frames until the stream ends or no more data arrives; then the connection is closed."""
        with self.container, self.copy or nullcontext():
            moments = decode(self.container, self.stream)
            if self.container.duration is None:
                moments = in_wall_clock(moments, time.time)
            yield from frames_of(moments, frame_rate(self.stream) or DEFAULT_FPS)


def in_wall_clock(moments: Iterator[Moment], now: Callable[[], float]) -> Iterator[Moment]:
    """Shift times of the sender so that the first time is the time of arrival.

    The shift is renewed after every jump back in time and after a picture without a time stamp.
    """
    offset, last = None, None
    for moment in moments:
        if moment.seconds is None:
            offset = None
            yield replace(moment, seconds=now())
            continue
        if offset is None or last is None or moment.seconds < last:
            offset = now() - moment.seconds
        last = moment.seconds
        yield replace(moment, seconds=moment.seconds + offset)


def open_url(url: str) -> NetworkVideo:
    """Connect to a stream.

    Raises
    ------
    InputError
        If the scheme is unknown, or if no source of video answers within 10 s.
    """
    parts = urlsplit(url)
    # Neither a password nor a token of the URL may reach a message or a folder's name.
    public = f"{parts.scheme}://{parts.netloc.rpartition('@')[-1]}{parts.path}"
    if parts.scheme.lower() not in _SCHEMES:
        raise InputError(f"unknown kind of stream, expected {', '.join(_SCHEMES)}", file=public)
    av = optional_import("av", extra="video", purpose="reading streams")
    # Over UDP, the default of RTSP, lost packets damage picture after picture.
    options = {"rtsp_transport": "tcp"} if parts.scheme.startswith("rtsp") else {}
    copied = _copy_of(url, public) if parts.scheme.startswith("http") else None
    try:
        container = open_container(copied or url, options=options, timeout=_TIMEOUT_S)
    except av.FFmpegError as error:
        if copied is not None:
            copied.close()
        raise InputError(f"cannot be opened as a stream ({error.strerror})", file=public) from None
    stream = video_stream(container, public)
    live = container.duration is None
    return NetworkVideo(
        name=re.sub(r"[^\w.-]+", "-", public.partition("://")[-1]).strip("-."),
        count=None if live else frame_count(container, stream),
        timestamp_source="wall clock" if live else "video",
        container=container,
        stream=stream,
        copy=copied,
    )


def _copy_of(url: str, public: str) -> IO[bytes] | None:
    """A temporary copy of a recording on a server that sends no byte ranges.

    The copy is necessary because the index may be at the end of the recording, which FFmpeg can
    read first only with byte ranges. The result is None if the server sends byte ranges, if the
    data has no known end (a live stream), or if the server does not answer as expected. FFmpeg then
    opens the URL and reports any failure.

    Raises
    ------
    InputError
        If the recording is too large to be copied.
    """
    try:
        with urllib.request.urlopen(url, timeout=_TIMEOUT_S) as answer:
            size = int(answer.headers.get("Content-Length") or 0)
            if size == 0 or answer.headers.get("Accept-Ranges", "none").lower() == "bytes":
                return None
            if size <= _LARGEST_COPY_BYTES:
                copy = tempfile.TemporaryFile()  # noqa: SIM115 (it lives as long as the video)
                shutil.copyfileobj(answer, copy)
                copy.seek(0)
                return copy
    except (OSError, ValueError, http.client.HTTPException):
        return None
    raise InputError(
        f"the server gives no parts of files (HTTP ranges), and this one has {size >> 20} MB: "
        "download it first",
        file=public,
    )
