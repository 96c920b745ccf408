"""A few pictures of ``overlay.mp4`` as JPEG."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from farpoint.errors import MissingExtraError, optional_import

__all__ = ["Still", "evenly_spaced_key_packets", "stills_at", "thumbs_of"]

_WIDTH_PX, _QUALITY = 960, 74
_THUMB_WIDTH_PX, _THUMB_QUALITY = 360, 55
_TIME_TOLERANCE_S = 1e-4  # times in the video are rounded to ticks


@dataclass(frozen=True, kw_only=True)
class Still:
    """A picture of the video.

    Attributes
    ----------
    time_s : float
        Time since the start of the video, s.
    jpeg : bytes
        The picture as JPEG.
    """

    time_s: float
    jpeg: bytes


def thumbs_of(path: Path, count: int) -> list[Still]:
    """At most `count` small key frames, evenly spread over a video; empty without a video.

    At most twice `count` packets of key frames are in memory. If a killed process has left an
    incomplete video, the pictures come from the readable part.
    """

    def read(stream: Any, packets: Iterable[Any]) -> list[Still]:
        return [
            _still([packet], stream, _THUMB_WIDTH_PX, _THUMB_QUALITY)
            for packet in evenly_spaced_key_packets(packets, count)
        ]

    return _from_video(path, read)


def stills_at(path: Path, times_s: Iterable[float]) -> list[Still]:
    """Pictures of a video at these times, s since the start of the video, sorted by time.

    A time after the readable part of a video, which a killed process has left incomplete, gives no
    picture.
    """
    wanted = sorted(set(times_s))

    def read(stream: Any, packets: Iterable[Any]) -> list[Still]:
        """Decode each wanted picture from the previous key frame on.

        ``packets`` must be in the order of the video.
        """
        stills: list[Still] = []
        group: list[Any] = []  # packets since the last key frame, needed to decode a picture
        for packet in packets:
            if packet.pts is None:
                continue
            group = [packet] if packet.is_keyframe else [*group, packet]
            time_s = float(packet.pts * packet.time_base)
            while len(stills) < len(wanted) and time_s >= wanted[len(stills)] - _TIME_TOLERANCE_S:
                stills.append(_still(group, stream, _WIDTH_PX, _QUALITY))
        return stills

    return _from_video(path, read)


def _from_video(path: Path, read: Callable[[Any, Iterable[Any]], list[Still]]) -> list[Still]:
    try:
        av = optional_import("av", extra="video", purpose="pictures in the report")
        optional_import("cv2", extra="video", purpose="pictures in the report")
    except MissingExtraError:
        return []
    try:
        with av.open(str(path)) as video:
            stream = video.streams.video[0]
            return read(stream, video.demux(stream))
    except (av.FFmpegError, OSError, IndexError):  # no video, or a video without pictures
        return []


def evenly_spaced_key_packets(packets: Iterable[Any], count: int) -> list[Any]:
    """Evenly spread packets of key frames: every k-th is kept; k doubles if too many are kept."""
    kept: list[Any] = []
    step = 1
    keys = (packet for packet in packets if packet.is_keyframe and packet.pts is not None)
    for index, packet in enumerate(keys):
        if index % step:
            continue
        kept.append(packet)
        if len(kept) > 2 * count:
            kept, step = kept[::2], 2 * step
    if len(kept) > 1:
        kept = kept[1:]  # the first frame has no motion to show
    chosen = min(count, len(kept))
    return [kept[(2 * k + 1) * len(kept) // (2 * chosen)] for k in range(chosen)]


def _still(packets: list[Any], stream: Any, width_px: int, quality: int) -> Still:
    """The last picture of ``packets``, the first of which is a key frame."""
    cv2 = optional_import("cv2", extra="video", purpose="pictures in the report")
    last, decoder = packets[-1], stream.codec_context
    frames = [frame for packet in packets for frame in decoder.decode(packet)]
    frames += decoder.decode(None)
    decoder.flush_buffers()
    picture = frames[-1].to_ndarray(format="bgr24")
    height, width = picture.shape[:2]
    if width > width_px:
        size = (width_px, round(height * width_px / width))
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    _, jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return Still(time_s=float(last.pts * last.time_base), jpeg=jpeg.tobytes())
