"""MCAP files.

https://mcap.dev/spec
"""

from __future__ import annotations

import re
import struct
import zlib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from farpoint.frames.bags.compression import LARGEST_CHUNK_BYTES, decompress
from farpoint.frames.bags.record_file import IndexEntry, Parsed, Record, RecordFile
from farpoint.frames.bags.records import BrokenBagError, Topic

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


class McapFile(RecordFile):
    """A ``.mcap`` file."""

    MAGIC, NAME = MAGIC, "an MCAP file"
    MESSAGE, CHUNK, INDEX = _MESSAGE, _CHUNK, _MESSAGE_INDEX
    DECLARING = frozenset({_SCHEMA, _CHANNEL})

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._schemas: dict[int, tuple[str, str, bytes]] = {}  # name, encoding, data

    def _record(self, file: BinaryIO, at: int) -> Record | None:
        file.seek(at)
        data = file.read(_HEAD.size)
        if len(data) < _HEAD.size:
            raise BrokenBagError("the file ends without its last record")
        op, size = _HEAD.unpack(data)
        record = Record(op, at + _HEAD.size, size)
        too_large = size > LARGEST_CHUNK_BYTES or (
            op in (_SCHEMA, _CHANNEL, _STATISTICS) and size > _LARGEST_SMALL_RECORD
        )
        if not 0 < op <= _DATA_END or too_large:
            raise BrokenBagError("not a record")
        if op != _CHUNK and record.end > self._size:
            raise BrokenBagError("the file ends in the middle of a record")
        return None if op in (_DATA_END, _FOOTER) else record

    def _record_in(self, raw: memoryview, at: int) -> Record:
        if at + _HEAD.size > len(raw):
            raise BrokenBagError("a record is cut off")
        op, size = _HEAD.unpack_from(raw, at)
        record = Record(op, at + _HEAD.size, size)
        if record.end > len(raw):
            raise BrokenBagError("a record is cut off or damaged")
        if op not in (_MESSAGE, _SCHEMA, _CHANNEL) and op < 0x80:
            raise BrokenBagError("a record of an unknown kind")
        return record

    def _parse(self, record: Record, data: memoryview) -> Parsed:
        del record
        if len(data) < _ENVELOPE.size:
            raise BrokenBagError("a message is cut off")
        channel, _, time_ns, _ = _ENVELOPE.unpack_from(data)
        return Parsed(channel, time_ns, data[_ENVELOPE.size :])

    def _unpack(self, record: Record, data: memoryview) -> memoryview:
        del record
        try:
            _, _, size, checksum, length = _CHUNK_HEAD.unpack_from(data)
            kind = bytes(data[_CHUNK_HEAD.size : _CHUNK_HEAD.size + length]).decode("ascii")
            begin = _CHUNK_HEAD.size + length + 8
            stored = _U64.unpack_from(data, begin - 8)[0]
        except (struct.error, UnicodeDecodeError):
            raise BrokenBagError("the head of a chunk is damaged") from None
        raw = decompress(data[begin : begin + stored], kind, size)
        # Without compression, damage is found in single records or in the decoding of messages.
        if kind and checksum and len(raw) == size and zlib.crc32(raw) != checksum:
            raise BrokenBagError("its checksum is wrong")
        return raw

    def _entries(self, record: Record, data: bytes) -> Iterator[IndexEntry]:
        del record
        if len(data) < 6:
            raise BrokenBagError("an index is cut off")
        channel = _U16.unpack_from(data)[0]
        for time_ns, offset in struct.iter_unpack("<QQ", data[6 : 6 + (len(data) - 6) // 16 * 16]):
            yield IndexEntry(channel, time_ns, offset)

    def _read_summary(self, file: BinaryIO) -> Counter[str]:
        file.seek(max(self._size - _FOOTER_BYTES, 0))
        end = file.read()
        if len(end) != _FOOTER_BYTES or not end.endswith(MAGIC) or end[0] != _FOOTER:
            raise BrokenBagError("the file has no end")
        at = _U64.unpack_from(end, _HEAD.size)[0]
        counts: Counter[str] | None = None
        while 0 < at < self._size:
            record = self._record(file, at)
            if record is None:
                break
            at = record.end
            if record.op not in (_SCHEMA, _CHANNEL, _STATISTICS):
                continue
            file.seek(record.data_at)
            data = file.read(record.size)
            if record.op == _STATISTICS:
                counts = self._counts(data)
            else:
                self._declare(record, data)
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

    def _declare(self, record: Record, data: bytes) -> None:
        try:
            number = _U16.unpack_from(data)[0]
            if record.op == _SCHEMA:
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

    def _next_beginning(self, file: BinaryIO, at: int) -> int | None:
        while at < self._size:
            file.seek(at)
            block = file.read(_BLOCK + _OVERLAP)
            for hit in _BEGINNINGS.finditer(block):
                if self._begins(file, at + hit.start()):
                    return at + hit.start()
            at += _BLOCK
        return None

    def _begins(self, file: BinaryIO, at: int) -> bool:
        """Whether a chunk with matching sizes, or a message before a record, begins at a byte."""
        try:
            record = self._record(file, at)
            if record is None:
                return False
            if record.op == _CHUNK:
                file.seek(record.data_at)
                head = file.read(_CHUNK_HEAD.size + 16)
                first, last, _, _, length = _CHUNK_HEAD.unpack_from(head)
                stored = _U64.unpack_from(head, _CHUNK_HEAD.size + length)[0]
                return first <= last and record.size == _CHUNK_HEAD.size + length + 8 + stored
            file.seek(record.data_at)
            if record.op != _MESSAGE or _U16.unpack(file.read(2))[0] not in self._channels:
                return False
            self._record(file, record.end)
        except (BrokenBagError, struct.error):
            return False
        return True


def _text(data: bytes, at: int) -> tuple[str, int]:
    """The text at a position, and the position of the end of the text."""
    size = _U32.unpack_from(data, at)[0]
    return data[at + 4 : at + 4 + size].decode(), at + 4 + size


def _ros2_name(name: str) -> str:
    package, _, kind = name.partition("/")
    return f"{package}/msg/{kind.removeprefix('msg/')}"
