"""Decoding one video stream packet by packet, surviving the packets that cannot be decoded."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from farpoint.errors import optional_import
from farpoint.frames.luma import grey_image

__all__ = ["Moment", "decode"]

# No codec in use delays a picture by more than 16 others (H.264, HEVC).
_REORDER_DEPTH = 16


@dataclass(frozen=True, kw_only=True, eq=False)
class Moment:
    """A picture of a video, or what happened instead of one.

    Attributes
    ----------
    seconds : float or None
        Time by the clock of the container; None where the container carries none.
    image : ndarray of uint8, shape (height, width), or None
        Grey values, upright.
    fault : str or None
        Why there is no image.
    """

    seconds: float | None
    image: np.ndarray | None = None
    fault: str | None = None


def decode(container: Any, stream: Any) -> Iterator[Moment]:
    """Pictures and faults of a stream of an open ``av`` container, in the order of their times.

    Pictures leave the decoder later than the packets they came in, so a packet's fault waits
    until the pictures before it are out.
    """
    waiting: list[tuple[float, int, Moment]] = []
    for number, moment in enumerate(_decode_in_storage_order(container, stream)):
        seconds = moment.seconds
        if moment.fault is not None and seconds is not None:
            heapq.heappush(waiting, (seconds, number, moment))
            if len(waiting) > _REORDER_DEPTH:
                yield heapq.heappop(waiting)[-1]
            continue
        while waiting and (seconds is None or waiting[0][0] <= seconds):
            yield heapq.heappop(waiting)[-1]
        yield moment
    while waiting:
        yield heapq.heappop(waiting)[-1]


def _decode_in_storage_order(container: Any, stream: Any) -> Iterator[Moment]:
    """Pictures as they leave the decoder, faults as they occur, and why the stream ends early."""
    av = optional_import("av", extra="video", purpose="reading video")
    packets, read, end = container.demux(stream), 0, 0.0
    while True:
        try:
            packet = next(packets)
        except StopIteration:
            break
        except av.FFmpegError as error:
            yield from _decode_packet(stream, None)  # what the decoder still holds
            yield Moment(seconds=None, fault=f"reading stopped: {error.strerror}")
            return
        read += packet.size > 0  # the last packet is empty: it makes the decoder finish
        if packet.pts is not None:
            end = max(end, float((packet.pts + (packet.duration or 0)) * stream.time_base))
        yield from _decode_packet(stream, packet)
    if fault := _find_truncation(container, stream, read, end):
        yield Moment(seconds=None, fault=fault)


def _find_truncation(container: Any, stream: Any, read: int, end_s: float) -> str | None:
    """What is missing at the end by the account of the header, where it gives one."""
    if read < stream.frames:
        return f"the video ends after {read} of the {stream.frames} frames its header announces"
    if stream.frames == 0 and container.duration is not None:
        announced_s = ((container.start_time or 0) + container.duration) / 1e6  # from us
        # Sound may go on a little longer than the pictures, and both count.
        if announced_s - end_s > max(1.0, 0.02 * announced_s):
            return (
                f"the video ends at {end_s:.1f} s of the {announced_s:.1f} s its header announces"
            )
    return None


def _decode_packet(stream: Any, packet: Any) -> Iterator[Moment]:
    av = optional_import("av", extra="video", purpose="reading video")
    try:
        for picture in stream.decode(packet):
            if picture.is_corrupt:  # partly made up by the decoder: worse than no picture
                yield Moment(seconds=picture.time, fault="decoded only in part: data is damaged")
            else:
                yield Moment(seconds=picture.time, image=grey_image(picture))
    except av.FFmpegError as error:
        pts = None if packet is None else packet.pts
        seconds = None if pts is None else float(pts * stream.time_base)
        yield Moment(seconds=seconds, fault=f"cannot be decoded: {error.strerror}")
