"""Decoding of a video stream packet by packet, which continues after damaged packets."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from farpoint.errors import optional_import
from farpoint.frames.depth import GreyTable
from farpoint.frames.luma import Grey

__all__ = ["Moment", "decode", "frame_rate"]

# No codec in use delays a picture by more than 16 others (H.264, HEVC).
_REORDER_DEPTH = 16


@dataclass(frozen=True, kw_only=True, eq=False)
class Moment:
    """A picture of a video, or a fault.

    Attributes
    ----------
    seconds : float or None
        Time stamp in the container, s; None if the picture has no time stamp.
    image : ndarray of uint8, shape (height, width), or None
        Grey values, upright.
    fault : str or None
        Reason why there is no image; None for a picture.
    deep : GreyTable or None
        Table from samples of 16 bits to grey values.
    """

    seconds: float | None
    image: np.ndarray | None = None
    fault: str | None = None
    deep: GreyTable | None = None


def decode(container: Any, stream: Any, deep: GreyTable | None = None) -> Iterator[Moment]:
    """Pictures and faults of a stream of an open ``av`` container, in the order of their times.

    Samples of 16 bits are mapped to grey values by the table ``deep``, or by a table made from the
    first picture if ``deep`` is None.

    The decoder may return a picture several packets after the packet of the picture. The fault of a
    packet is therefore returned after the pictures of earlier packets.
    """
    waiting: list[tuple[float, int, Moment]] = []
    for number, moment in enumerate(_decode_in_storage_order(container, stream, deep)):
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


def _decode_in_storage_order(
    container: Any, stream: Any, deep: GreyTable | None
) -> Iterator[Moment]:
    """Pictures and faults in the order of the decoder, and the reason of an early end."""
    av = optional_import("av", extra="video", purpose="reading video")
    packets, end_s = container.demux(stream), 0.0
    grey = Grey(deep)
    incomplete: set[int] = set()  # pts of packets cut short
    while True:
        try:
            packet = next(packets)
        except StopIteration:
            break
        except av.FFmpegError as error:
            yield from _decode_packet(
                stream, None, incomplete, grey
            )  # what the decoder still holds
            yield Moment(seconds=None, fault=f"reading stopped: {error.strerror}")
            return
        if packet.is_corrupt and packet.pts is not None:
            incomplete.add(packet.pts)
        if (start_s := _seconds(packet.pts, stream)) is not None:
            end_s = max(end_s, start_s + float((packet.duration or 0) * stream.time_base))
        yield from _decode_packet(stream, packet, incomplete, grey)
    if fault := _find_truncation(container, stream, end_s):
        yield Moment(seconds=None, fault=fault)


def _decode_packet(stream: Any, packet: Any, incomplete: set[int], grey: Grey) -> Iterator[Moment]:
    """Pictures that the decoder returns for a packet (None: end of stream), or the error."""
    av = optional_import("av", extra="video", purpose="reading video")
    try:
        for picture in stream.decode(packet):
            seconds = _seconds(picture.pts, stream)
            # A picture with concealed errors is worse than no picture.
            if picture.is_corrupt or picture.pts in incomplete:
                yield Moment(seconds=seconds, fault="decoded only in part: data is damaged")
            else:
                yield Moment(seconds=seconds, image=grey(picture), deep=grey.deep)
    except av.FFmpegError as error:
        seconds = None if packet is None else _seconds(packet.pts, stream)
        yield Moment(seconds=seconds, fault=f"cannot be decoded: {error.strerror}")


def frame_rate(stream: Any) -> float | None:
    """Frames per second in the header of a stream; None if missing."""
    # A missing rate is None before PyAV 19, and 0 / 0 from PyAV 19 on.
    rate = float(stream.average_rate or 0)
    return rate if 0.0 < rate < math.inf else None


def _seconds(pts: int | None, stream: Any) -> float | None:
    # Not picture.time: the last pictures that the decoder returns have no time base.
    return None if pts is None else float(pts * stream.time_base)


def _find_truncation(container: Any, stream: Any, end_s: float) -> str | None:
    """Description of a missing part at the end of the stream, or None.

    The function compares the time of the last picture with the duration in the header. The number
    of pictures would not show a truncation, because the header of an AVI file also counts the
    missing pictures.
    """
    rate = frame_rate(stream)
    if stream.frames > 0 and rate is not None:
        duration_s, tolerance_s = stream.frames / rate, max(0.1, 1.5 / rate)
    elif container.duration is not None:
        duration_s = container.duration / 1e6  # from us
        tolerance_s = max(1.0, 0.02 * duration_s)  # includes sound, which may end later
    else:
        return None
    announced_s = (container.start_time or 0) / 1e6 + duration_s
    if announced_s - end_s <= tolerance_s:
        return None
    return f"the video ends at {end_s:.2f} s of the {announced_s:.2f} s its header announces"
