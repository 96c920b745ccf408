"""Selection of a topic of a bag."""

from __future__ import annotations

from collections.abc import Callable, Collection
from contextlib import suppress
from typing import Any

from farpoint.errors import InputError
from farpoint.frames.bags.decoding import by_definition, decoder_of, kind_of, stamp_ns
from farpoint.frames.bags.images import COMPRESSED, RAW, VIDEO
from farpoint.frames.bags.records import Bag, BrokenBagError, Topic

__all__ = ["image_topic", "rows_of", "topic_of_kind"]

_IMAGES = RAW | COMPRESSED | VIDEO
_DEPTH = "/compressedDepth"  # a transport whose images are distances


def image_topic(bag: Bag, name: str | None) -> Topic:
    """The topic of the images: the named topic, or else the only image topic.

    Raises
    ------
    InputError
        If there is no such topic, or if no topic is named and the bag has several image topics. The
        message lists the topics with their counts.
    """
    if name is not None:
        return topic_of_kind(bag, name, _IMAGES, "images", field="topic")
    images = [
        topic
        for topic in bag.topics()
        if kind_of(topic) in _IMAGES and topic.count != 0 and not topic.name.endswith(_DEPTH)
    ]
    if not images:
        raise InputError(f"holds no images; its topics are {_listed(bag.topics())}", file=bag.path)
    if len(images) > 1:
        raise InputError(
            f"several topics hold images: expected one of {_listed(images)} (--topic)",
            file=bag.path,
            field="topic",
        )
    return images[0]


def topic_of_kind(bag: Bag, name: str, kinds: Collection[str], what: str, *, field: str) -> Topic:
    """The topic of this name, with a type of one of these kinds.

    Raises
    ------
    InputError
        If there is no such topic. The message lists the topics of these kinds.
    """
    plain = name.strip("/")
    of_kind = [topic for topic in bag.topics() if kind_of(topic) in kinds]
    for topic in bag.topics():
        if topic.name.strip("/") == plain:
            if topic not in of_kind:
                raise InputError(
                    f"{name} holds {topic.type_name}; expected {what}: {_listed(of_kind)}",
                    file=bag.path,
                    field=field,
                )
            return topic
    raise InputError(
        f"no topic {name}; expected one of {_listed(of_kind)}", file=bag.path, field=field
    )


def rows_of(
    bag: Bag,
    name: str,
    kinds: Collection[str],
    read: Callable[[Any], tuple[float, ...] | None],
    what: str,
    *,
    field: str,
) -> list[tuple[float, ...]]:
    """Time, s, and numbers of each message, in ascending order of time.

    Damaged messages, and messages that are not later than the previous one, are left out.

    Parameters
    ----------
    bag : Bag
        The recording.
    name : str
        Name of the topic.
    kinds : collection of str
        Types that the topic may have.
    read : callable
        Returns the numbers of a message, or None if the message is not used.
    what : str
        Expected content of the topic, for errors.
    field : str
        Option named in errors.

    Raises
    ------
    InputError
        If the bag has no topic of this name and kind. The message lists the topics of these kinds.
    """
    topic = topic_of_kind(bag, name, kinds, what, field=field)
    decode, last_ns = decoder_of(topic), -1
    rows: list[tuple[float, ...]] = []
    for message in bag.messages((topic.name,)):
        if message.fault is not None:
            continue
        with suppress(BrokenBagError), by_definition():
            found = decode(message.data)
            time_ns, row = stamp_ns(found) or message.time_ns, read(found)
            if row is not None and time_ns is not None and time_ns > last_ns:
                last_ns = time_ns
                rows.append((time_ns / 10**9, *row))
    return rows


def _listed(topics: Collection[Topic]) -> str:
    """Names of topics with counts of messages, as text."""
    return ", ".join(f"{topic.name} ({_count(topic)})" for topic in topics) or "none"


def _count(topic: Topic) -> str:
    return "?" if topic.count is None else str(topic.count)
