"""Interface of bags: topics, and messages in the order of the file."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

__all__ = ["Bag", "BrokenBagError", "Message", "Topic"]


class BrokenBagError(Exception):
    """Error: bytes of a bag violate the format. The package catches each such error."""


@dataclass(frozen=True, kw_only=True)
class Topic:
    """A topic of a bag, and the encoding of its messages.

    Attributes
    ----------
    name : str
        Name, such as ``/camera/image_raw``.
    type_name : str
        Name of the type, such as ``sensor_msgs/msg/Image`` (also for ROS 1) or
        ``foxglove.CompressedVideo``.
    encoding : str
        ``ros1``, ``cdr``, ``protobuf`` or ``json``.
    definition : str
        Definition of the type, in ROS's language; empty if the bag has no definition.
    is_idl : bool
        Whether the definition is written in IDL.
    count : int or None
        Number of messages; None if the number is known only after reading the bag.
    """

    name: str
    type_name: str
    encoding: str
    definition: str = ""
    is_idl: bool = False
    count: int | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Message:
    """A message as bytes, or a lost message with its fault.

    Attributes
    ----------
    topic : Topic or None
        Topic of the message; None for a lost part of the bag with unknown topics.
    time_ns : int or None
        Time of recording, ns; None if the time is lost.
    data : bytes or memoryview
        Bytes of the message; empty if the message is lost.
    fault : str or None
        Reason of the loss; None for a complete message.
    """

    topic: Topic | None
    time_ns: int | None
    data: bytes | memoryview = b""
    fault: str | None = None


class Bag(Protocol):
    """A recording that is open for reading, without messages in memory."""

    @property
    def path(self) -> Path:
        """File or folder of the bag."""
        ...

    def topics(self) -> list[Topic]:
        """Every topic.

        Raises
        ------
        InputError
            If the file is no bag of the expected kind, or is completely unreadable.
        """
        ...

    def messages(self, names: Collection[str]) -> Iterator[Message]:
        """Messages of the named topics, and faults for lost parts, in the order of the file."""
        ...
