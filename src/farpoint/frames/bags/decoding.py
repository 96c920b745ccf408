"""Decoding of messages: ROS types by rosbags, other types by their own definitions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from typing import Any

from farpoint.errors import optional_import
from farpoint.frames.bags.protobuf import from_json, from_protobuf
from farpoint.frames.bags.records import BrokenBagError, Topic

__all__ = ["Decoder", "by_definition", "decoder_of", "kind_of", "stamp_ns"]

Decoder = Callable[[bytes | memoryview], Any]
"""Returns an object with the fields of a message, or raises BrokenBagError."""


def kind_of(topic: Topic) -> str:
    """The last part of a type's name, such as ``Image`` of ``sensor_msgs/msg/Image``."""
    return topic.type_name.replace(".", "/").rpartition("/")[2]


def decoder_of(topic: Topic) -> Decoder:
    """Decoder of the messages of a topic."""
    decode = _function(topic)

    def checked(data: bytes | memoryview) -> Any:
        try:
            return decode(data)
        except Exception as error:  # damaged bytes cause many kinds of errors
            words = str(error).strip() or type(error).__name__
            raise BrokenBagError(f"the message cannot be read ({words})") from error

    return checked


def stamp_ns(message: Any) -> int:
    """Time stamp of a message, ns; 0 if no time stamp was set.

    Raises BrokenBagError if the type has no time stamp.
    """
    with by_definition():
        header = getattr(message, "header", None)
        stamp = message.timestamp if header is None else header.stamp
        return int(stamp.sec) * 10**9 + int(stamp.nanosec)


@contextmanager
def by_definition() -> Iterator[None]:
    """Context in which a missing or unusable field raises BrokenBagError.

    Such a field is possible because the definitions in a bag may be damaged.
    """
    try:
        yield
    except (AttributeError, TypeError, ValueError, OverflowError) as error:
        raise BrokenBagError(f"the message has other fields than its type ({error})") from error


def _function(topic: Topic) -> Decoder:
    if topic.encoding in ("protobuf", "json"):
        kind = kind_of(topic)
        read = from_protobuf if topic.encoding == "protobuf" else from_json
        return lambda data: read(data, kind)
    name = topic.type_name
    store = _typestore(name, topic.encoding, topic.definition, topic.is_idl)
    if topic.encoding == "ros1":
        return lambda data: store.deserialize_ros1(data, name)
    return lambda data: store.deserialize_cdr(data, name)


@lru_cache(maxsize=64)
def _typestore(name: str, encoding: str, definition: str, is_idl: bool) -> Any:
    """Types from the definition in the bag, or the types of ROS if there is no definition."""
    typesys = optional_import("rosbags.typesys", extra="ros", purpose="reading a bag")
    stores = typesys.Stores
    if definition:
        parse = typesys.get_types_from_idl if is_idl else typesys.get_types_from_msg
        arguments = (definition,) if is_idl else (definition, name)
        # If the definition is damaged, ROS's own definition is used, which fits in most cases.
        with suppress(Exception):
            store = typesys.get_typestore(stores.EMPTY)
            store.register(parse(*arguments))
            return store
    return typesys.get_typestore(stores.ROS1_NOETIC if encoding == "ros1" else stores.LATEST)
