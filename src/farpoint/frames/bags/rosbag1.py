"""ROS 1 bags, version 2.0.

http://wiki.ros.org/Bags/Format/2.0
"""

from __future__ import annotations

import re
import struct
from collections import Counter
from collections.abc import Iterator
from typing import BinaryIO

from farpoint.errors import InputError
from farpoint.frames.bags.compression import LARGEST_CHUNK_BYTES, decompress
from farpoint.frames.bags.record_file import IndexEntry, Parsed, Record, RecordFile
from farpoint.frames.bags.records import BrokenBagError, Topic

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


class Ros1Bag(RecordFile):
    """A ``.bag`` file."""

    MAGIC, NAME = MAGIC, "a ROS 1 bag of version 2.0"
    MESSAGE, CHUNK, INDEX = _MESSAGE, _CHUNK, _INDEX
    DECLARING = frozenset({_CONNECTION})

    def _record(self, file: BinaryIO, at: int) -> Record | None:
        if at >= self._size:
            return None
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
        header = _fields(data[:size])
        record = Record(_op(header), at + size + 8, _U32.unpack_from(data, size)[0], header)
        largest = _LARGEST_DEFINITION if record.op == _CONNECTION else LARGEST_CHUNK_BYTES
        if not _MESSAGE <= record.op <= _CONNECTION or record.size > largest:
            raise BrokenBagError("not a record")
        if record.op != _CHUNK and record.end > self._size:
            raise BrokenBagError("the bag ends in the middle of a record")
        return record

    def _record_in(self, raw: memoryview, at: int) -> Record:
        try:
            size = _U32.unpack_from(raw, at)[0]
            header = _fields(bytes(raw[at + 4 : at + 4 + size]))
            record = Record(
                _op(header), at + size + 8, _U32.unpack_from(raw, at + 4 + size)[0], header
            )
        except struct.error:
            raise BrokenBagError("a record is cut off or damaged") from None
        if record.end > len(raw):
            raise BrokenBagError("a message is cut off")
        if record.op not in (_MESSAGE, _CONNECTION):
            raise BrokenBagError("a record of an unknown kind")
        return record

    def _parse(self, record: Record, data: memoryview) -> Parsed:
        time = _u64(record.header, b"time")
        time_ns = (time & 0xFFFFFFFF) * 10**9 + (time >> 32)
        return Parsed(_u32(record.header, b"conn"), time_ns, data)

    def _unpack(self, record: Record, data: memoryview) -> memoryview:
        kind = record.header.get(b"compression", b"").decode("latin-1")
        return decompress(data, kind, _u32(record.header, b"size"))

    def _entries(self, record: Record, data: bytes) -> Iterator[IndexEntry]:
        channel, count = _u32(record.header, b"conn"), _u32(record.header, b"count")
        body = data[: min(len(data) // 12, count) * 12]
        for second, nanosecond, offset in struct.iter_unpack("<3I", body):
            yield IndexEntry(channel, second * 10**9 + nanosecond, offset)

    def _read_summary(self, file: BinaryIO) -> Counter[str]:
        bag = self._record(file, len(MAGIC))
        if bag is None:
            raise BrokenBagError("the bag is empty")
        at = _u64(bag.header, b"index_pos")
        if bag.op != _BAG or at == 0:
            raise BrokenBagError("the bag has no index")
        if bag.header.get(b"encryptor"):
            raise InputError("is encrypted", file=self.path)
        counts: Counter[str] = Counter()
        left = _u32(bag.header, b"conn_count") + _u32(bag.header, b"chunk_count")
        for _ in range(left):
            record = self._record(file, at)
            if record is None:
                raise BrokenBagError("the index is cut off")
            file.seek(record.data_at)
            data = file.read(record.size)
            if record.op == _CONNECTION:
                self._declare(record, data)
            elif record.op == _CHUNK_INFO:
                for number, count in struct.iter_unpack("<2I", data[: len(data) // 8 * 8]):
                    if topic := self._channels.get(number):
                        counts[topic.name] += count
            else:
                raise BrokenBagError("the index is damaged")
            at = record.end
        return counts

    def _declare(self, record: Record, data: bytes) -> None:
        header = record.header
        try:
            number, fields = _u32(header, b"conn"), _fields(data)
            name = "/".join(part for part in header[b"topic"].decode().split("/") if part)
            package, _, kind = fields[b"type"].decode().partition("/")
            definition = fields[b"message_definition"].decode(errors="replace")
        except (BrokenBagError, KeyError, UnicodeDecodeError):
            return
        self._channels.setdefault(
            number,
            Topic(
                name=f"/{name}",
                type_name=f"{package}/msg/{kind}",
                encoding="ros1",
                definition=definition,
            ),
        )

    def _next_beginning(self, file: BinaryIO, at: int) -> int | None:
        while at < self._size:
            file.seek(at)
            block = file.read(_BLOCK + _CHUNK_HEADER_BYTES)
            for hit in _CHUNK_OP.finditer(block):
                for begin in range(max(hit.start() - _CHUNK_HEADER_BYTES, 0), hit.start() - 7):
                    try:
                        record = self._record(file, at + begin)
                    except BrokenBagError:
                        continue
                    if record is None or record.op != _CHUNK:
                        continue
                    if {b"compression", b"size"} <= record.header.keys():
                        return at + begin
            at += _BLOCK
        return None


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
