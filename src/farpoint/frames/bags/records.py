"""What every kind of bag comes down to: topics, and messages in the order of the file."""

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
    """A topic of a bag, and how its messages are written.

    Attributes
    ----------
    name : str
        Such as ``/camera/image_raw``.
    type_name : str
        Such as ``sensor_msgs/msg/Image``, of ROS 1 too, or ``foxglove.CompressedVideo``.
    encoding : str
        ``ros1``, ``cdr``, ``protobuf`` or ``json``.
    definition : str
        Of the type, in ROS's language; empty where the bag has none.
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
    """A message as bytes, or the account of one that is lost.

    Attributes
    ----------
    topic : Topic or None
        None where a part of the bag is lost, whatever it held.
    time_ns : int or None
        When it was recorded; None where that is lost.
    data : bytes or memoryview
        Without the envelope of the bag; empty where it is lost.
    fault : str or None
        Why it is lost.
    """

    topic: Topic | None
    time_ns: int | None
    data: bytes | memoryview = b""
    fault: str | None = None


class Bag(Protocol):
    """A recording that is open for reading; nothing of it stays in memory."""

    @property
    def path(self) -> Path:
        """File or folder."""
        ...

    def topics(self) -> list[Topic]:
        """Every topic.

        Raises
        ------
        InputError
            Where the file is no bag of its kind, or nothing of it can be read.
        """
        ...

    def messages(self, names: Collection[str]) -> Iterator[Message]:
        """Messages of the topics of these names, and what is lost, in the order of the file."""
        ...
