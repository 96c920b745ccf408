"""MCAP files, read from one end to the other.

Records follow one another: chunks of messages, each with its index behind it, or messages by
themselves. The summary at the end of the file is used where it is there.
https://mcap.dev/spec
"""

from __future__ import annotations

import re
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import BinaryIO

from farpoint.errors import InputError
from farpoint.frames.bags.chunks import IndexEntry, Parsed, chunk_messages, seconds
from farpoint.frames.bags.compression import LARGEST_CHUNK_BYTES, decompress
from farpoint.frames.bags.records import BrokenBagError, Message, Topic

__all__ = ["MAGIC", "McapFile"]

MAGIC = b"\x89MCAP0\r\n"

_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _MESSAGE_INDEX = 2, 3, 4, 5, 6, 7
_STATISTICS, _DATA_END = 0x0B, 0x0F
_HEAD = struct.Struct("<BQ")  # opcode and size of a record
_ENVELOPE = struct.Struct("<HIQQ")  # of a message: channel, sequence, log time, publish time
_CHUNK_HEAD = struct.Struct("<QQQII")  # first, last, size, checksum, length of the compression
_COUNT = struct.Struct("<HQ")
_U16, _U32, _U64 = struct.Struct("<H"), struct.Struct("<I"), struct.Struct("<Q")
_FOOTER_BYTES = _HEAD.size + 20 + len(MAGIC)
_LARGEST_SMALL_RECORD = 1 << 24  # schemas, channels, statistics
_BLOCK = 1 << 22
_OVERLAP = 64
# How a chunk and a message begin: the sizes of both are below 4 GiB.
_BEGINNINGS = re.compile(
    rb"\x06.{4}\x00{4}.{28}(?:\x00{4}|\x03\x00\x00\x00lz4|\x04\x00\x00\x00zstd)|\x05.{4}\x00{4}",
    re.DOTALL,
)


class McapFile:
    """A ``.mcap`` file.

    Parameters
    ----------
    path : Path
        The file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._size = path.stat().st_size
        self._schemas: dict[int, tuple[str, str, bytes]] = {}  # name, encoding, data
        self._channels: dict[int, Topic] = {}

    def topics(self) -> list[Topic]:
        """By the summary at the end of the file, or, where it is missing, by all of the file."""
        with self.path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise InputError("expected an MCAP file", file=self.path)
            try:
                counts = self._read_summary(file)
            except BrokenBagError:
                counts = Counter(
                    message.topic.name for message in self._messages(file, None) if message.topic
                )
        topics = {topic.name: topic for topic in self._channels.values()}
        return [replace(topic, count=counts[name]) for name, topic in topics.items()]

    def messages(self, names: Collection[str]) -> Iterator[Message]:
        """Messages of some topics; chunks that are damaged give what their index leads to."""
        with self.path.open("rb") as file:
            yield from self._messages(file, names)

    def _messages(self, file: BinaryIO, names: Collection[str] | None) -> Iterator[Message]:
        """Messages of some topics, or of all where no names are given."""

        def wanted(number: int) -> Topic | None:
            topic = self._channels.get(number)
            return topic if topic and (names is None or topic.name in names) else None

        at: int | None = len(MAGIC)
        while at is not None:
            try:
                op, data_at, size = self._head(file, at)
            except BrokenBagError as error:
                begin, at = at, self._next_beginning(file, at + 1)
                end = "reading stopped" if at is None else f"reading goes on at byte {at}"
                yield self._loss(f"is damaged at byte {begin} of {self._size} ({error}): {end}")
                continue
            if op in (_DATA_END, _FOOTER):
                return
            at = data_at + size
            if op == _CHUNK:
                is_cut_off = at > self._size
                for message in self._chunk(file, data_at, size, wanted):
                    if message.topic is not None or not is_cut_off:
                        yield message
                if is_cut_off:
                    yield self._loss(f"ends at byte {self._size} in the middle of a chunk")
                    return
            elif op == _MESSAGE:
                file.seek(data_at)
                yield from self._message(file.read(size), wanted)
            elif op in (_SCHEMA, _CHANNEL):
                file.seek(data_at)
                self._declare(op, file.read(size))

    def _loss(self, problem: str) -> Message:
        return Message(topic=None, time_s=None, fault=f"{self.path.name} {problem}")

    def _message(self, data: bytes, wanted: Callable[[int], Topic | None]) -> Iterator[Message]:
        """A message outside of a chunk."""
        try:
            record = _parsed(memoryview(data))
        except BrokenBagError as error:
            yield Message(topic=None, time_s=None, fault=str(error))
            return
        if topic := wanted(record.channel):
            yield Message(topic=topic, time_s=seconds(record.time_ns), data=record.data)

    def _chunk(
        self, file: BinaryIO, at: int, size: int, wanted: Callable[[int], Topic | None]
    ) -> Iterator[Message]:
        file.seek(at)
        data = file.read(size)
        return chunk_messages(
            lambda: _unpack(memoryview(data)),
            self._records,
            _message_at,
            partial(self._index, file, at + size),
            wanted,
            f"the chunk at byte {at}",
        )

    def _records(self, raw: memoryview) -> Iterator[Parsed]:
        at = 0
        while at < len(raw):
            if at + _HEAD.size > len(raw):
                raise BrokenBagError("a record is cut off")
            op, size = _HEAD.unpack_from(raw, at)
            at += _HEAD.size + size
            if at > len(raw):
                raise BrokenBagError("a record is cut off or damaged")
            if op == _MESSAGE:
                yield _parsed(raw[at - size : at])
            elif op in (_SCHEMA, _CHANNEL):
                self._declare(op, bytes(raw[at - size : at]))
            elif op < 0x80:
                raise BrokenBagError("a record of an unknown kind")

    def _index(self, file: BinaryIO, at: int) -> list[IndexEntry]:
        """The index records that follow a chunk."""
        entries: list[IndexEntry] = []
        while True:
            try:
                op, data_at, size = self._head(file, at)
            except BrokenBagError:
                return entries
            if op != _MESSAGE_INDEX or size < 6:
                return entries
            file.seek(data_at)
            data = file.read(size)
            channel, at = _U16.unpack_from(data)[0], data_at + size
            body = data[6 : 6 + (len(data) - 6) // 16 * 16]
            entries += [
                IndexEntry(channel, time_ns, offset)
                for time_ns, offset in struct.iter_unpack("<QQ", body)
            ]

    def _read_summary(self, file: BinaryIO) -> Counter[str]:
        """Schemas, channels, and how many messages each topic has, by the end of the file."""
        file.seek(max(self._size - _FOOTER_BYTES, 0))
        end = file.read()
        if len(end) != _FOOTER_BYTES or not end.endswith(MAGIC) or end[0] != _FOOTER:
            raise BrokenBagError("the file has no end")
        at = _U64.unpack_from(end, _HEAD.size)[0]
        counts: Counter[str] | None = None
        while 0 < at < self._size:
            op, data_at, size = self._head(file, at)
            if op == _FOOTER:
                break
            at = data_at + size
            if op not in (_SCHEMA, _CHANNEL, _STATISTICS):
                continue
            file.seek(data_at)
            data = file.read(size)
            if op == _STATISTICS:
                counts = self._counts(data)
            else:
                self._declare(op, data)
        if counts is None or not self._channels:
            raise BrokenBagError("the file has no summary")
        return counts

    def _counts(self, statistics: bytes) -> Counter[str]:
        counts: Counter[str] = Counter()
        body = statistics[46:]
        for number, count in _COUNT.iter_unpack(body[: len(body) // _COUNT.size * _COUNT.size]):
            if topic := self._channels.get(number):
                counts[topic.name] += count
        return counts

    def _declare(self, op: int, data: bytes) -> None:
        """Remember a schema or a channel; one that is damaged is left out."""
        try:
            number = _U16.unpack_from(data)[0]
            if op == _SCHEMA:
                name, at = _text(data, 2)
                encoding, at = _text(data, at)
                size = _U32.unpack_from(data, at)[0]
                self._schemas[number] = (name, encoding, data[at + 4 : at + 4 + size])
                return
            schema = _U16.unpack_from(data, 2)[0]
            name, at = _text(data, 4)
            encoding, _ = _text(data, at)
        except (struct.error, UnicodeDecodeError):
            return
        type_name, language, definition = self._schemas.get(schema, ("", "", b""))
        is_ros = language in ("ros2msg", "ros2idl", "omgidl", "ros1msg")
        self._channels[number] = Topic(
            name=name,
            type_name=_ros2_name(type_name) if language == "ros1msg" else type_name,
            encoding=encoding,
            definition=definition.decode(errors="replace") if is_ros else "",
            is_idl=language.endswith("idl"),
        )

    def _head(self, file: BinaryIO, at: int) -> tuple[int, int, int]:
        """Opcode of the record at a byte of the file, where its data begins, and its size."""
        file.seek(at)
        data = file.read(_HEAD.size)
        if len(data) < _HEAD.size:
            raise BrokenBagError("the file ends without its last record")
        op, size = _HEAD.unpack(data)
        at += _HEAD.size
        known = 0 < op <= _DATA_END
        too_large = size > LARGEST_CHUNK_BYTES or (
            op in (_SCHEMA, _CHANNEL, _STATISTICS) and size > _LARGEST_SMALL_RECORD
        )
        if not known or too_large:
            raise BrokenBagError("not a record")
        if op != _CHUNK and at + size > self._size:
            raise BrokenBagError("the file ends in the middle of a record")
        return op, at, size

    def _next_beginning(self, file: BinaryIO, at: int) -> int | None:
        """Where the next chunk or message begins, by its bytes."""
        while at < self._size:
            file.seek(at)
            block = file.read(_BLOCK + _OVERLAP)
            for hit in _BEGINNINGS.finditer(block):
                if self._begins(file, at + hit.start()):
                    return at + hit.start()
            at += _BLOCK
        return None

    def _begins(self, file: BinaryIO, at: int) -> bool:
        """Whether a record begins here: what follows it must be one, too."""
        try:
            op, data_at, size = self._head(file, at)
            if op == _CHUNK:
                file.seek(data_at)
                head = file.read(_CHUNK_HEAD.size + 16)
                first, last, _, _, length = _CHUNK_HEAD.unpack_from(head)
                stored = _U64.unpack_from(head, _CHUNK_HEAD.size + length)[0]
                return first <= last and size == _CHUNK_HEAD.size + length + 8 + stored
            file.seek(data_at)
            if op != _MESSAGE or _U16.unpack(file.read(2))[0] not in self._channels:
                return False
            self._head(file, data_at + size)
        except (BrokenBagError, struct.error):
            return False
        return True


def _unpack(data: memoryview) -> memoryview:
    """What a chunk holds."""
    try:
        _, _, size, checksum, length = _CHUNK_HEAD.unpack_from(data)
        kind = bytes(data[_CHUNK_HEAD.size : _CHUNK_HEAD.size + length]).decode("ascii")
        begin = _CHUNK_HEAD.size + length + 8
        stored = _U64.unpack_from(data, begin - 8)[0]
    except (struct.error, UnicodeDecodeError):
        raise BrokenBagError("the head of a chunk is damaged") from None
    raw = decompress(data[begin : begin + stored], kind, size)
    # What is not compressed is left to its records, and what these hold to its decoders.
    if kind and checksum and len(raw) == size and zlib.crc32(raw) != checksum:
        raise BrokenBagError("its checksum is wrong")
    return raw


def _message_at(raw: memoryview, at: int) -> Parsed:
    if at + _HEAD.size > len(raw):
        raise BrokenBagError("the record is cut off")
    op, size = _HEAD.unpack_from(raw, at)
    begin = at + _HEAD.size
    if op != _MESSAGE or begin + size > len(raw):
        raise BrokenBagError("the record is damaged")
    return _parsed(raw[begin : begin + size])


def _parsed(data: memoryview) -> Parsed:
    if len(data) < _ENVELOPE.size:
        raise BrokenBagError("a message is cut off")
    channel, _, time_ns, _ = _ENVELOPE.unpack_from(data)
    return Parsed(channel, time_ns, data[_ENVELOPE.size :])


def _text(data: bytes, at: int) -> tuple[str, int]:
    """The text at a place, and where it ends."""
    size = _U32.unpack_from(data, at)[0]
    return data[at + 4 : at + 4 + size].decode(), at + 4 + size


def _ros2_name(name: str) -> str:
    package, _, kind = name.partition("/")
    return f"{package}/msg/{kind.removeprefix('msg/')}"
