"""The images of one topic of a bag, one after the other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from farpoint.camera import Camera
from farpoint.errors import InputError, optional_import
from farpoint.frames.bags.calibration import camera_of
from farpoint.frames.bags.clock import HeaderClock
from farpoint.frames.bags.decoding import by_definition, decoder_of, kind_of, stamp_ns
from farpoint.frames.bags.images import VIDEO, samples_of
from farpoint.frames.bags.kinds import open_bag
from farpoint.frames.bags.records import Bag, BrokenBagError, Message, Topic
from farpoint.frames.bags.topics import image_topic
from farpoint.frames.bags.video import Picture, VideoTopic
from farpoint.frames.decode import MAX_MEGAPIXELS, UnreadableImageError
from farpoint.frames.depth import EXAMPLES, GreyTable
from farpoint.frames.frame import Frame

__all__ = ["BagImages", "open_bag_images"]

_FIRST = 15
"""Number of readable messages from which the clock and the frame id of a topic are taken."""


@dataclass(frozen=True, kw_only=True)
class BagImages:
    """Images of a topic, read one at a time. The object can be iterated repeatedly.

    Attributes
    ----------
    bag : Bag
        The recording.
    topic : Topic
        Topic of the images.
    name : str
        Name of the bag, without suffix.
    clock : HeaderClock
        Clock from the first images, with which each iteration starts.
    frame_id : str
        Most frequent frame id of the first images, which is the camera's optical frame.
    max_megapixels : float
        Size limit of an image. A larger image is a frame with a fault.
    """

    bag: Bag
    topic: Topic
    name: str
    clock: HeaderClock
    frame_id: str
    max_megapixels: float = MAX_MEGAPIXELS
    calibration_path: Path | None = None

    @property
    def count(self) -> int | None:
        """Number of messages as counted in the bag; None if unknown."""
        return self.topic.count

    @property
    def timestamp_source(self) -> str:
        """Origin of the time stamps: headers, or the recording if the headers have no times."""
        what = "recording" if self.clock.offset_ns is None else "headers"
        return f"{what} of {self.topic.name}"

    @property
    def notes(self) -> tuple[str, ...]:
        """A note about the mapping of samples of more than 8 bits to grey values, if necessary."""
        if kind_of(self.topic) in VIDEO:
            return ()
        return (self._deep.words,) if self._deep.words else ()

    def camera(self) -> Camera:
        """The camera from the CameraInfo in the bag; raises InputError if there is none."""
        return camera_of(self.bag, self.topic, self.frame_id)

    def __iter__(self) -> Iterator[Frame]:
        """Frames in the order of the bag; an unreadable image is a frame with a fault."""
        pictures = self._video() if kind_of(self.topic) in VIDEO else self._images()
        for index, picture in enumerate(pictures):
            yield Frame(
                index=index,
                timestamp=picture.label / 10**9,
                time_ns=picture.label,
                image=picture.image,
                name=str(index),
                fault=picture.fault,
            )

    def _images(self) -> Iterator[Picture[int]]:
        for time_ns, message, fault in self._messages():
            image = None
            if fault is None:
                try:
                    image = samples_of(message, kind_of(self.topic), self.max_megapixels)
                    if image.dtype == np.uint16:
                        image = self._deep(image)
                except UnreadableImageError as error:
                    fault = str(error)
            yield Picture(time_ns, image, fault)

    def _video(self) -> Iterator[Picture[int]]:
        video = VideoTopic[int]()
        for time_ns, message, fault in self._messages():
            data, kind = b"", ""
            if fault is None:
                try:
                    with by_definition():
                        data, kind = bytes(message.data), str(message.format)
                except BrokenBagError as error:
                    fault = str(error)
            if fault is None:
                yield from video.add(data, kind, time_ns)
            else:
                yield from video.pass_over(time_ns, fault)
        yield from video.close()

    def _messages(self) -> Iterator[tuple[int, Any, str | None]]:
        """Time of each message, ns, and the message or the reason why the message is unreadable."""
        decode, clock = decoder_of(self.topic), replace(self.clock)
        for message in self.bag.messages((self.topic.name,)):
            found, fault = None, message.fault
            time_ns: int | None = None
            if fault is None:
                try:
                    found = decode(message.data)
                    time_ns = clock.take(stamp_ns(found), message.time_ns)
                    if time_ns is None:
                        fault = "the time stamp of the message is damaged"
                except BrokenBagError as error:
                    fault = str(error)
            yield clock.guess(message.time_ns) if time_ns is None else time_ns, found, fault

    @cached_property
    def _deep(self) -> GreyTable:
        """Table for samples of more than 8 bits, from images throughout the bag."""
        return GreyTable.for_source(self._examples())

    def _examples(self) -> Iterator[np.ndarray]:
        decode, step = decoder_of(self.topic), max((self.count or 0) // EXAMPLES, 1)
        messages: Iterator[Message] = self.bag.messages((self.topic.name,))
        for index, message in enumerate(messages):
            if index == EXAMPLES and self.count is None:
                return
            if index % step or message.fault is not None:
                continue
            with suppress(UnreadableImageError, BrokenBagError):
                yield samples_of(decode(message.data), kind_of(self.topic), self.max_megapixels)


def open_bag_images(path: Path, topic: str | None) -> BagImages:
    """Open the images of a bag, and check that there is at least one image.

    Parameters
    ----------
    path : Path
        File or folder.
    topic : str or None
        Topic of the images; None if the bag has only one image topic.

    Raises
    ------
    InputError
        If ``path`` is no bag, if there are no such images, or if the bag has several image topics
        and ``topic`` is None.
    """
    optional_import("cv2", extra="video", purpose="reading images")  # before the run starts
    bag = open_bag(path)
    images = image_topic(bag, topic)
    first, frame_ids = _first(bag, images)
    if not first:
        raise InputError(f"{images.name} holds no message that can be read", file=path)
    return BagImages(
        bag=bag,
        topic=images,
        name=path.resolve().name if path.is_dir() else path.stem,
        clock=HeaderClock.of_first(first),
        frame_id=Counter(frame_ids).most_common(1)[0][0],
    )


def _first(bag: Bag, topic: Topic) -> tuple[list[tuple[int, int | None]], list[str]]:
    """Header and recording times, ns, of the first messages, and frame ids of these messages."""
    decode, stamps, frames = decoder_of(topic), [], []
    for message in bag.messages((topic.name,)):
        if message.fault is None:
            with suppress(BrokenBagError):
                found = decode(message.data)
                stamps.append((stamp_ns(found), message.time_ns))
                frames.append(str(getattr(getattr(found, "header", found), "frame_id", "")))
        if len(stamps) == _FIRST:
            break
    return stamps, frames
