"""A topic of compressed video: each message is one picture, decoded after earlier messages."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from farpoint.errors import optional_import
from farpoint.frames.luma import Grey

__all__ = ["Picture", "VideoTopic"]

_CODECS = {"h264": "h264", "h265": "hevc", "hevc": "hevc", "vp9": "vp9", "vp8": "vp8", "av1": "av1"}
_REORDER_DEPTH = 16  # pictures a decoder holds back at the most

Label = TypeVar("Label")


@dataclass(frozen=True, eq=False)
class Picture(Generic[Label]):
    """Result of a message: an image, or a fault."""

    label: Label
    image: np.ndarray | None
    fault: str | None


class VideoTopic(Generic[Label]):
    """Decodes messages one after the other; each message gives one `Picture`, in order."""

    def __init__(self) -> None:
        self._codec: Any = None
        self._grey = Grey()
        self._waiting: deque[tuple[int, Label]] = deque()
        self._count = 0

    def add(self, data: bytes, kind: str, label: Label) -> Iterator[Picture[Label]]:
        """Decode a message; returns finished pictures, each with the ``label`` of its message."""
        av = optional_import("av", extra="video", purpose="reading video")
        number, self._count = self._count, self._count + 1
        self._waiting.append((number, label))
        try:
            if self._codec is None:
                self._codec = _open(av, kind)
            packet = av.Packet(data)
            packet.pts = number
            pictures = self._codec.decode(packet)
        except (av.FFmpegError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            yield from self._until(number)
            yield from self._fail(number, f"cannot be decoded: {reason}")
            return
        yield from self._given(pictures)
        while len(self._waiting) > _REORDER_DEPTH:
            yield from self._fail(self._waiting[0][0], "no picture came of it")

    def pass_over(self, label: Label, fault: str) -> Iterator[Picture[Label]]:
        """Skip a lost message; returns its ``fault``, after the faults of earlier messages."""
        number, self._count = self._count, self._count + 1
        yield from self._until(number)
        yield Picture(label, None, fault)

    def close(self) -> Iterator[Picture[Label]]:
        """Pictures that are still in the decoder, and faults of the remaining messages."""
        if self._codec is not None:
            av = optional_import("av", extra="video", purpose="reading video")
            with suppress(av.FFmpegError):
                yield from self._given(self._codec.decode(None))
        yield from self._until(self._count)

    def _given(self, pictures: list[Any]) -> Iterator[Picture[Label]]:
        for picture in pictures:
            number = self._count - 1 if picture.pts is None else picture.pts
            yield from self._until(number)
            if not self._waiting or self._waiting[0][0] != number:
                continue
            _, label = self._waiting.popleft()
            # A picture with concealed errors is worse than no picture.
            if picture.is_corrupt:
                yield Picture(label, None, "decoded only in part: data is damaged")
            else:
                yield Picture(label, self._grey(picture), None)

    def _until(self, number: int) -> Iterator[Picture[Label]]:
        """Faults of the messages before ``number`` that gave no picture."""
        while self._waiting and self._waiting[0][0] < number:
            yield Picture(self._waiting.popleft()[1], None, "no picture came of it")

    def _fail(self, number: int, fault: str) -> Iterator[Picture[Label]]:
        while self._waiting and self._waiting[0][0] <= number:
            yield Picture(self._waiting.popleft()[1], None, fault)


def _open(av: Any, kind: str) -> Any:
    name = _CODECS.get(kind.lower())
    if name is None:
        raise ValueError(f"the format {kind!r} is not supported; expected {', '.join(_CODECS)}")
    codec = av.CodecContext.create(name, "r")
    # The decoder returns pictures in the order of their messages and without extra delay.
    codec.thread_count = 1
    codec.flags |= av.codec.context.Flags.low_delay
    return codec
