"""A few pictures out of ``overlay.mp4``, as JPEG, whatever its length."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from farpoint.errors import MissingExtraError, optional_import

__all__ = ["Still", "spread_key_packets", "stills_of"]

_MAX_WIDTH_PX = 960
_JPEG_QUALITY = 78


@dataclass(frozen=True, kw_only=True)
class Still:
    """A picture of the film.

    Attributes
    ----------
    time_s : float
        Seconds since its start.
    jpeg : bytes
        The picture.
    """

    time_s: float
    jpeg: bytes


def stills_of(path: Path, count: int) -> list[Still]:
    """At most `count` key frames, spread evenly over a film; none if there is no film to read.

    Only the packets of key frames are held, and never more than twice `count`; a film cut off by
    a kill gives what it has.
    """
    try:
        av = optional_import("av", extra="video", purpose="pictures in the report")
        cv2 = optional_import("cv2", extra="video", purpose="pictures in the report")
    except MissingExtraError:
        return []
    try:
        with av.open(str(path)) as film:
            stream = film.streams.video[0]
            packets = spread_key_packets(film.demux(stream), count)
            return [_still(packet, stream, cv2) for packet in packets]
    except (av.FFmpegError, OSError, IndexError):  # no film, or none with a picture in it
        return []


def spread_key_packets(packets: Iterable[Any], count: int) -> list[Any]:
    """Key packets evenly spread: every k-th is kept, and k doubles when there are too many."""
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
        kept = kept[1:]  # the first frame has no pair yet, hence nothing to show
    chosen = min(count, len(kept))
    return [kept[(2 * k + 1) * len(kept) // (2 * chosen)] for k in range(chosen)]


def _still(packet: Any, stream: Any, cv2: Any) -> Still:
    time_s = float(packet.pts * packet.time_base)
    decoder = stream.codec_context
    frame = [*decoder.decode(packet), *decoder.decode(None)][0]
    decoder.flush_buffers()
    picture = frame.to_ndarray(format="bgr24")
    height, width = picture.shape[:2]
    if width > _MAX_WIDTH_PX:
        size = (_MAX_WIDTH_PX, round(height * _MAX_WIDTH_PX / width))
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    _, jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    return Still(time_s=time_s, jpeg=jpeg.tobytes())
