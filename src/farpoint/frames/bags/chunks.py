"""Messages of one chunk: in the order of time, and from its index where its bytes are damaged."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from operator import itemgetter

from farpoint.frames.bags.records import BrokenBagError, Message, Topic

__all__ = ["IndexEntry", "Parsed", "chunk_messages", "seconds"]


@dataclass(frozen=True)
class IndexEntry:
    """Where the index of a chunk says a message is.

    Attributes
    ----------
    channel : int
        Number of the topic in the bag.
    time_ns : int
        When it was recorded.
    offset : int
        Of its record in the unpacked chunk.
    """

    channel: int
    time_ns: int
    offset: int


@dataclass(frozen=True)
class Parsed:
    """A message record: its channel, its time, and its bytes."""

    channel: int
    time_ns: int
    data: memoryview


def seconds(time_ns: int) -> float:
    """Seconds, exact to the nearest float."""
    return time_ns / 10**9


def chunk_messages(
    unpack: Callable[[], memoryview],
    records: Callable[[memoryview], Iterable[Parsed]],
    record_at: Callable[[memoryview, int], Parsed],
    index: Callable[[], list[IndexEntry]],
    wanted: Callable[[int], Topic | None],
    where: str,
) -> Iterator[Message]:
    """Messages of the channels of a chunk that are wanted.

    Parameters
    ----------
    unpack : callable
        Gives the bytes of the chunk, or raises BrokenBagError.
    records : callable
        Gives the records of these bytes one after the other, or raises BrokenBagError.
    record_at : callable
        Gives the record at an offset, or raises BrokenBagError.
    index : callable
        Gives the index that follows the chunk: asked only where the chunk is damaged.
    wanted : callable
        Gives the topic of a channel; None of one that is not wanted. Asked when a record has been
        read: channels may come up within a chunk.
    where : str
        What to call the chunk.
    """
    try:
        raw = unpack()
    except BrokenBagError as error:
        entries = index()
        for entry in sorted(entries, key=_time):
            if topic := wanted(entry.channel):
                yield _lost(topic, entry, f"{where}: {error}")
        if not entries:
            yield Message(topic=None, time_s=None, fault=f"{where} is lost: {error}")
        return
    found: list[tuple[int, Message]] = []
    fault = None
    try:
        for record in records(raw):
            if topic := wanted(record.channel):
                found.append((record.time_ns, _whole(topic, record)))
    except BrokenBagError as error:
        fault = f"{where}: {error}"
    if fault is not None and (entries := index()):
        yield from _by_index(raw, record_at, entries, wanted)
        return
    for _, message in sorted(found, key=itemgetter(0)):
        yield message
    if fault is not None:
        yield Message(topic=None, time_s=None, fault=fault)


def _by_index(
    raw: memoryview,
    record_at: Callable[[memoryview, int], Parsed],
    entries: list[IndexEntry],
    wanted: Callable[[int], Topic | None],
) -> Iterator[Message]:
    """What the index leads to; a record that is not what the index says is lost."""
    for entry in sorted(entries, key=_time):
        topic = wanted(entry.channel)
        if topic is None:
            continue
        try:
            record = record_at(raw, entry.offset)
        except BrokenBagError as error:
            yield _lost(topic, entry, str(error))
            continue
        yield _whole(topic, Parsed(entry.channel, entry.time_ns, record.data))


def _time(entry: IndexEntry) -> int:
    return entry.time_ns


def _whole(topic: Topic, record: Parsed) -> Message:
    return Message(topic=topic, time_s=seconds(record.time_ns), data=record.data)


def _lost(topic: Topic, entry: IndexEntry, fault: str) -> Message:
    return Message(topic=topic, time_s=seconds(entry.time_ns), fault=fault)
