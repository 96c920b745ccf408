"""A bag that is one file of records (ROS 1 bags and MCAP files), read from beginning to end.

The file is a sequence of records: chunks of messages, each followed by an index of the chunk, or
single messages. Only the current chunk is kept in memory. If the file ends with a summary, the
summary is used. Subclasses define the record format.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field, replace
from operator import attrgetter
from pathlib import Path
from typing import BinaryIO, ClassVar

from farpoint.errors import InputError
from farpoint.frames.bags.records import BrokenBagError, Message, Topic

__all__ = ["IndexEntry", "Parsed", "Record", "RecordFile"]

Wanted = Callable[[int], Topic | None]
"""Returns the topic of a channel; None if the topic is not requested."""


@dataclass(frozen=True)
class Record:
    """Kind of a record, and position of the data in the file or in a decompressed chunk.

    Attributes
    ----------
    op : int
        Kind of the record: its operation code in the format.
    data_at : int
        Position of the data of the record.
    size : int
        Size of the data, bytes.
    header : dict
        Fields before the data, if the format has such fields.
    """

    op: int
    data_at: int
    size: int
    header: dict[bytes, bytes] = field(default_factory=dict)

    @property
    def end(self) -> int:
        """Position of the next record."""
        return self.data_at + self.size


@dataclass(frozen=True)
class IndexEntry:
    """Position of a message, from the index of a chunk.

    Attributes
    ----------
    channel : int
        Number of the topic in the bag.
    time_ns : int
        Time of recording, ns.
    offset : int
        Position of the message's record in the decompressed chunk.
    """

    channel: int
    time_ns: int
    offset: int


@dataclass(frozen=True)
class Parsed:
    """A message record: channel, time, and bytes of the message."""

    channel: int
    time_ns: int
    data: memoryview


class RecordFile(ABC):
    """A file of records.

    Parameters
    ----------
    path : Path
        The file.
    """

    MAGIC: ClassVar[bytes]
    NAME: ClassVar[str]
    """Name of the format."""

    MESSAGE: ClassVar[int]
    CHUNK: ClassVar[int]
    INDEX: ClassVar[int]
    DECLARING: ClassVar[frozenset[int]]
    """Kinds of the records that describe topics."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._size = path.stat().st_size
        self._channels: dict[int, Topic] = {}

    def topics(self) -> list[Topic]:
        """Topics from the summary of the file, or from the whole file if there is no summary."""
        with self.path.open("rb") as file:
            if file.read(len(self.MAGIC)) != self.MAGIC:
                raise InputError(f"expected {self.NAME}", file=self.path)
            try:
                counts = self._read_summary(file)
            except BrokenBagError:
                counts = Counter(
                    message.topic.name for message in self._messages(file, None) if message.topic
                )
        topics = {topic.name: topic for topic in self._channels.values()}
        return [replace(topic, count=counts[name]) for name, topic in topics.items()]

    def messages(self, names: Collection[str]) -> Iterator[Message]:
        """Messages of some topics; the index locates messages in a damaged chunk."""
        with self.path.open("rb") as file:
            yield from self._messages(file, names)

    @abstractmethod
    def _record(self, file: BinaryIO, at: int) -> Record | None:
        """The record at a position of the file; None after the last record.

        A chunk that is cut off by the end of the file is returned like a whole chunk. The method
        raises BrokenBagError if no record begins at the position, or if any other record is cut off
        by the end of the file.
        """

    @abstractmethod
    def _record_in(self, raw: memoryview, at: int) -> Record:
        """The record at a byte of an unpacked chunk; damage raises BrokenBagError."""

    @abstractmethod
    def _declare(self, record: Record, data: bytes) -> None:
        """Add the topics of a record; a damaged topic is left out."""

    @abstractmethod
    def _parse(self, record: Record, data: memoryview) -> Parsed:
        """The message of a record; damage raises BrokenBagError."""

    @abstractmethod
    def _unpack(self, record: Record, data: memoryview) -> memoryview:
        """The decompressed chunk, in part if truncated; damage raises BrokenBagError."""

    @abstractmethod
    def _entries(self, record: Record, data: bytes) -> Iterator[IndexEntry]:
        """Entries of an index record; damage raises BrokenBagError."""

    @abstractmethod
    def _read_summary(self, file: BinaryIO) -> Counter[str]:
        """Declare all topics and count their messages from the summary at the end of the file.

        Raises BrokenBagError if the file ends without a summary.
        """

    @abstractmethod
    def _next_beginning(self, file: BinaryIO, at: int) -> int | None:
        """Position of the next recognisable chunk or message after a byte."""

    def _messages(self, file: BinaryIO, names: Collection[str] | None) -> Iterator[Message]:
        """Messages of the named topics, or of all topics if ``names`` is None."""

        def wanted(number: int) -> Topic | None:
            topic = self._channels.get(number)
            return topic if topic and (names is None or topic.name in names) else None

        at: int | None = len(self.MAGIC)
        while at is not None:
            try:
                record = self._record(file, at)
            except BrokenBagError as error:
                begin, at = at, self._next_beginning(file, at + 1)
                end = "reading stopped" if at is None else f"reading goes on at byte {at}"
                yield _lost(
                    f"{self.path.name} is damaged at byte {begin} of {self._size} ({error}): {end}"
                )
                continue
            if record is None:
                return
            at = record.end
            if record.op == self.CHUNK:
                yield from self._chunk(file, record, wanted)
                if at > self._size:
                    yield _lost(
                        f"{self.path.name} ends at byte {self._size} in the middle of a chunk"
                    )
                    return
            elif record.op == self.MESSAGE:
                yield from self._single(record, memoryview(_data(file, record)), wanted)
            elif record.op in self.DECLARING:
                self._declare(record, _data(file, record))

    def _single(self, record: Record, data: memoryview, wanted: Wanted) -> Iterator[Message]:
        """A message outside of a chunk."""
        try:
            parsed = self._parse(record, data)
        except BrokenBagError as error:
            yield _lost(str(error))
            return
        if topic := wanted(parsed.channel):
            yield _whole(topic, parsed)

    def _chunk(self, file: BinaryIO, record: Record, wanted: Wanted) -> Iterator[Message]:
        """Messages of a chunk in order of time; the index locates messages in a damaged chunk."""
        where, is_cut_off = f"the chunk at byte {record.data_at}", record.end > self._size
        try:
            raw = self._unpack(record, memoryview(_data(file, record)))
        except BrokenBagError as error:
            entries = self._index(file, record.end)
            for entry in entries:
                if topic := wanted(entry.channel):
                    yield _lost(f"{where}: {error}", topic, entry)
            if not entries and not is_cut_off:
                yield _lost(f"{where} is lost: {error}")
            return
        found: list[tuple[Topic, Parsed]] = []
        fault = None
        try:
            for parsed in self._parsed(raw):
                # Called after the record is read, because a chunk may declare its topics.
                if topic := wanted(parsed.channel):
                    found.append((topic, parsed))
        except BrokenBagError as error:
            fault = f"{where}: {error}"
        if fault is not None and (entries := self._index(file, record.end)):
            yield from self._by_index(raw, entries, wanted)
            return
        for topic, parsed in sorted(found, key=lambda one: one[1].time_ns):
            yield _whole(topic, parsed)
        if fault is not None and not is_cut_off:
            yield _lost(fault)

    def _by_index(
        self, raw: memoryview, entries: list[IndexEntry], wanted: Wanted
    ) -> Iterator[Message]:
        """Messages located by the index; a record that contradicts the index is a lost message."""
        for entry in entries:
            topic = wanted(entry.channel)
            if topic is None:
                continue
            try:
                record = self._record_in(raw, entry.offset)
                if record.op != self.MESSAGE:
                    raise BrokenBagError("the record is damaged")
                parsed = self._parse(record, raw[record.data_at : record.end])
            except BrokenBagError as error:
                yield _lost(str(error), topic, entry)
                continue
            yield _whole(topic, Parsed(entry.channel, entry.time_ns, parsed.data))

    def _parsed(self, raw: memoryview) -> Iterator[Parsed]:
        """The messages of an unpacked chunk, one by one; damage raises BrokenBagError."""
        at = 0
        while at < len(raw):
            record = self._record_in(raw, at)
            data, at = raw[record.data_at : record.end], record.end
            if record.op == self.MESSAGE:
                yield self._parse(record, data)
            elif record.op in self.DECLARING:
                self._declare(record, bytes(data))

    def _index(self, file: BinaryIO, at: int) -> list[IndexEntry]:
        """Entries of the index records behind a chunk, by time."""
        entries: list[IndexEntry] = []
        try:
            while (record := self._record(file, at)) is not None and record.op == self.INDEX:
                entries += self._entries(record, _data(file, record))
                at = record.end
        except BrokenBagError:
            pass
        return sorted(entries, key=attrgetter("time_ns"))


def _data(file: BinaryIO, record: Record) -> bytes:
    file.seek(record.data_at)
    return file.read(record.size)


def _whole(topic: Topic, parsed: Parsed) -> Message:
    return Message(topic=topic, time_ns=parsed.time_ns, data=parsed.data)


def _lost(fault: str, topic: Topic | None = None, entry: IndexEntry | None = None) -> Message:
    return Message(topic=topic, time_ns=None if entry is None else entry.time_ns, fault=fault)
