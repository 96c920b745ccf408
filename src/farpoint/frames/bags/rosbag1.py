"""ROS 1 bags, version 2.0, read from one end to the other.

Records follow one another: chunks of messages, each with its index behind it. Nothing but the chunk
in hand is kept, and neither the index at the end of the file nor a whole file is needed.
http://wiki.ros.org/Bags/Format/2.0
"""

from __future__ import annotations

import re
import struct
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import BinaryIO

from farpoint.errors import InputError
from farpoint.frames.bags.chunks import IndexEntry, Parsed, chunk_messages
from farpoint.frames.bags.compression import decompress
from farpoint.frames.bags.records import BrokenBagError, Message, Topic

__all__ = ["MAGIC", "Ros1Bag"]

MAGIC = b"#ROSBAG V2.0\n"

_MESSAGE, _BAG, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 3, 4, 5, 6, 7
_U32, _U64 = struct.Struct("<I"), struct.Struct("<Q")
_LARGEST_HEADER = 1 << 16  # of a record; a few hundred bytes in use
_LARGEST_DEFINITION = 1 << 24
_BLOCK = 1 << 22
_CHUNK_OP = re.compile(rb"op=\x05")
_CHUNK_HEADER_BYTES = 80  # longest there is, with a margin

Header = dict[bytes, bytes]


@dataclass(frozen=True)
class _Record:
    """Header of a record, and where its data is in the file."""

    header: Header
    data_at: int
    data_size: int

    @property
    def op(self) -> int:
        return _op(self.header)


class Ros1Bag:
    """A ``.bag`` file.

    Parameters
    ----------
    path : Path
        The file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._size = path.stat().st_size
        self._connections: dict[int, Topic] = {}

    def topics(self) -> list[Topic]:
        """By the index at the end of the file, or, where it is missing, by all of the file."""
        with self.path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise InputError("expected a ROS 1 bag of version 2.0", file=self.path)
            try:
                counts = self._read_index(file)
            except BrokenBagError:
                counts = Counter(
                    message.topic.name for message in self._messages(file, None) if message.topic
                )
        topics = {topic.name: topic for topic in self._connections.values()}
        return [replace(topic, count=counts[name]) for name, topic in topics.items()]

    def messages(self, names: Collection[str]) -> Iterator[Message]:
        """Messages of some topics; chunks that are damaged give what their index leads to."""
        with self.path.open("rb") as file:
            yield from self._messages(file, names)

    def _messages(self, file: BinaryIO, names: Collection[str] | None) -> Iterator[Message]:
        """Messages of some topics, or of all where no names are given."""

        def wanted(number: int) -> Topic | None:
            topic = self._connections.get(number)
            return topic if topic and (names is None or topic.name in names) else None

        at: int | None = len(MAGIC)
        while at is not None and at < self._size:
            try:
                record = self._record(file, at)
            except BrokenBagError as error:
                begin, at = at, self._next_chunk(file, at + 1)
                end = "reading stopped" if at is None else f"reading goes on at byte {at}"
                yield self._loss(f"is damaged at byte {begin} of {self._size} ({error}): {end}")
                continue
            at = record.data_at + record.data_size
            if record.op == _CONNECTION:
                file.seek(record.data_at)
                self._connect(record.header, file.read(record.data_size))
            if record.op != _CHUNK:
                continue
            is_cut_off = at > self._size
            for message in self._chunk(file, record, wanted):
                if message.topic is not None or not is_cut_off:
                    yield message
            if is_cut_off:
                yield self._loss(f"ends at byte {self._size} in the middle of a chunk")

    def _loss(self, problem: str) -> Message:
        return Message(topic=None, time_s=None, fault=f"{self.path.name} {problem}")

    def _chunk(
        self, file: BinaryIO, record: _Record, wanted: Callable[[int], Topic | None]
    ) -> Iterator[Message]:
        file.seek(record.data_at)
        data = file.read(record.data_size)
        kind = record.header.get(b"compression", b"").decode("latin-1")
        return chunk_messages(
            lambda: decompress(memoryview(data), kind, _u32(record.header, b"size")),
            self._records,
            _message_at,
            partial(self._index, file, record.data_at + record.data_size),
            wanted,
            f"the chunk at byte {record.data_at}",
        )

    def _records(self, raw: memoryview) -> Iterator[Parsed]:
        at = 0
        while at < len(raw):
            header, data_at, size = _split(raw, at)
            at = data_at + size
            if at > len(raw):
                raise BrokenBagError("a message is cut off")
            if _op(header) == _MESSAGE:
                yield _message(header, raw[data_at:at])
            elif _op(header) == _CONNECTION:
                self._connect(header, bytes(raw[data_at:at]))
            else:
                raise BrokenBagError("a record of an unknown kind")

    def _index(self, file: BinaryIO, at: int) -> list[IndexEntry]:
        """The index records that follow a chunk."""
        entries: list[IndexEntry] = []
        while at < self._size:
            try:
                record = self._record(file, at)
                if record.op != _INDEX:
                    break
                channel, count = _u32(record.header, b"conn"), _u32(record.header, b"count")
            except BrokenBagError:
                break
            file.seek(record.data_at)
            data = file.read(min(record.data_size, 12 * count))
            for second, nanosecond, offset in struct.iter_unpack(
                "<3I", data[: len(data) // 12 * 12]
            ):
                entries.append(IndexEntry(channel, second * 10**9 + nanosecond, offset))
            at = record.data_at + record.data_size
        return entries

    def _read_index(self, file: BinaryIO) -> Counter[str]:
        """Connections, and how many messages each topic has, by the end of the file."""
        bag = self._record(file, len(MAGIC))
        at = _u64(bag.header, b"index_pos")
        if bag.op != _BAG or at == 0:
            raise BrokenBagError("the bag has no index")
        if bag.header.get(b"encryptor"):
            raise InputError("is encrypted", file=self.path)
        counts: Counter[str] = Counter()
        left = _u32(bag.header, b"conn_count") + _u32(bag.header, b"chunk_count")
        for _ in range(left):
            record = self._record(file, at)
            file.seek(record.data_at)
            data = file.read(record.data_size)
            if record.op == _CONNECTION:
                self._connect(record.header, data)
            elif record.op == _CHUNK_INFO and len(data) == record.data_size:
                for number, count in struct.iter_unpack("<2I", data[: len(data) // 8 * 8]):
                    if topic := self._connections.get(number):
                        counts[topic.name] += count
            else:
                raise BrokenBagError("the index is damaged")
            at = record.data_at + record.data_size
        return counts

    def _connect(self, header: Header, data: bytes) -> None:
        """Remember a connection; one that is damaged is left out."""
        try:
            number, fields = _u32(header, b"conn"), _fields(data)
            name = "/".join(part for part in header[b"topic"].decode().split("/") if part)
            package, _, kind = fields[b"type"].decode().partition("/")
            definition = fields[b"message_definition"].decode(errors="replace")
        except (BrokenBagError, KeyError, UnicodeDecodeError):
            return
        self._connections.setdefault(
            number,
            Topic(
                name=f"/{name}",
                type_name=f"{package}/msg/{kind}",
                encoding="ros1",
                definition=definition,
            ),
        )

    def _record(self, file: BinaryIO, at: int) -> _Record:
        """The record that begins at a byte of the file."""
        file.seek(at)
        begin = file.read(4)
        if len(begin) < 4:
            raise BrokenBagError("the bag ends in the middle of a record")
        size = _U32.unpack(begin)[0]
        if size > _LARGEST_HEADER:
            raise BrokenBagError("not a record")
        data = file.read(size + 4)
        if len(data) < size + 4:
            raise BrokenBagError("the bag ends in the middle of a record")
        record = _Record(_fields(data[:size]), at + size + 8, _U32.unpack_from(data, size)[0])
        if not _MESSAGE <= record.op <= _CONNECTION:
            raise BrokenBagError("not a record")
        if record.op == _CONNECTION and record.data_size > _LARGEST_DEFINITION:
            raise BrokenBagError("not a record")
        if record.op != _CHUNK and record.data_at + record.data_size > self._size:
            raise BrokenBagError("the bag ends in the middle of a record")
        return record

    def _next_chunk(self, file: BinaryIO, at: int) -> int | None:
        """Where the next chunk begins, by its bytes."""
        while at < self._size:
            file.seek(at)
            block = file.read(_BLOCK + _CHUNK_HEADER_BYTES)
            for hit in _CHUNK_OP.finditer(block):
                for begin in range(max(hit.start() - _CHUNK_HEADER_BYTES, 0), hit.start() - 7):
                    try:
                        record = self._record(file, at + begin)
                    except BrokenBagError:
                        continue
                    if record.op == _CHUNK and {b"compression", b"size"} <= record.header.keys():
                        return at + begin
            at += _BLOCK
        return None


def _message_at(raw: memoryview, at: int) -> Parsed:
    header, data_at, size = _split(raw, at)
    if _op(header) != _MESSAGE or data_at + size > len(raw):
        raise BrokenBagError("the record is damaged")
    return _message(header, raw[data_at : data_at + size])


def _message(header: Header, data: memoryview) -> Parsed:
    time = _u64(header, b"time")
    return Parsed(_u32(header, b"conn"), (time & 0xFFFFFFFF) * 10**9 + (time >> 32), data)


def _split(raw: memoryview, at: int) -> tuple[Header, int, int]:
    """Header of a record in an unpacked chunk, where its data begins, and the size of that."""
    try:
        size = _U32.unpack_from(raw, at)[0]
        header = _fields(bytes(raw[at + 4 : at + 4 + size]))
        return header, at + size + 8, _U32.unpack_from(raw, at + 4 + size)[0]
    except struct.error:
        raise BrokenBagError("the record is cut off or damaged") from None


def _fields(data: bytes) -> Header:
    fields: Header = {}
    at, end = 0, len(data)
    while at < end:
        if at + 4 > end:
            raise BrokenBagError("the header of a record is damaged")
        size = _U32.unpack_from(data, at)[0]
        at += 4 + size
        name, equals, value = data[at - size : at].partition(b"=")
        if at > end or not equals:
            raise BrokenBagError("the header of a record is damaged")
        fields[name] = value
    return fields


def _op(header: Header) -> int:
    value = header.get(b"op", b"")
    if len(value) != 1:
        raise BrokenBagError("the header of a record is damaged")
    return value[0]


def _u32(header: Header, name: bytes) -> int:
    return _number(_U32, header, name)


def _u64(header: Header, name: bytes) -> int:
    return _number(_U64, header, name)


def _number(kind: struct.Struct, header: Header, name: bytes) -> int:
    value = header.get(name, b"")
    if len(value) != kind.size:
        raise BrokenBagError(f"the header of a record lacks {name.decode()}")
    return kind.unpack(value)[0]
