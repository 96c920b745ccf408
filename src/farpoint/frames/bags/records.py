"""Interface of bags: topics, and messages in the order of the file."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

__all__ = ["Bag", "BrokenBagError", "Message", "Topic"]


class BrokenBagError(Exception):
    """Bytes of a bag violate its format. Never leaves this package."""


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
        Definition of the type, in ROS's language; empty where the bag has none.
    is_idl : bool
        Whether the definition is in IDL.
    count : int or None
        Number of messages; None where it is known only after reading the bag.
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
        None for a lost part of the bag with unknown topics.
    time_ns : int or None
        Time of recording, ns; None if it is lost.
    data : bytes or memoryview
        Bytes of the message; empty if it is lost.
    fault : str or None
        Reason of the loss.
    """

    topic: Topic | None
    time_ns: int | None
    data: bytes | memoryview = b""
    fault: str | None = None


class Bag(Protocol):
    """A recording that is open for reading, without messages in memory."""

    @property
    def path(self) -> Path:
        """File or folder."""
        ...

    def topics(self) -> list[Topic]:
        """Every topic.

        Raises
        ------
        InputError
            If the file is no bag of its kind, or nothing of it can be read.
        """
        ...

    def messages(self, names: Collection[str]) -> Iterator[Message]:
        """Messages of the named topics, and faults for lost parts, in the order of the file."""
        ...
