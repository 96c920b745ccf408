"""MCAP file that grows by whole chunks and their indexes. The summary is written at the end.

https://mcap.dev/spec
"""

from __future__ import annotations

import struct
import zlib
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import farpoint
from farpoint.sinks.files import AppendFile

__all__ = ["Channel", "McapFile"]

_MAGIC = b"\x89MCAP0\r\n"
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 1, 2, 3, 4, 5, 6
_MESSAGE_INDEX, _CHUNK_INDEX, _STATISTICS, _DATA_END = 7, 8, 0x0B, 0x0F
_CHUNK_BYTES = 1 << 15
"""Size of a chunk, about ten frames: a killed run loses at most one chunk."""


@dataclass(frozen=True)
class Channel:
    """A topic of the file."""

    number: int
    topic: str


class McapFile:
    """Writer of ROS 2 messages. Every chunk is in the file completely or not at all.

    Parameters
    ----------
    path : Path
        The file; an existing file is replaced.

    Raises
    ------
    InputError
        If the file cannot be written. Methods also raise this error.
    """

    def __init__(self, path: Path) -> None:
        head = _text("ros2") + _text(f"farpoint {farpoint.__version__}")
        first = _MAGIC + _record(_HEADER, head)
        self._file = AppendFile(path, first)
        self._at = len(first)
        self._schemas: dict[str, int] = {}
        self._declarations = b""  # records of schemas and channels, repeated in the summary
        self._counts: dict[int, int] = {}
        self._chunk = bytearray()
        self._index: dict[int, list[tuple[int, int]]] = defaultdict(list)
        self._chunk_indexes: list[bytes] = []
        self._first_ns, self._last_ns = (1 << 63) - 1, 0
        self._closed = False

    def add_channel(
        self, topic: str, type_name: str, definition: str, qos: str | None = None
    ) -> Channel:
        """Add a topic, with the definition of the message type and the publisher's QoS as YAML."""
        declared = b""
        if type_name not in self._schemas:
            number = len(self._schemas) + 1
            self._schemas[type_name] = number
            data = definition.encode()
            declared += _record(
                _SCHEMA,
                struct.pack("<H", number)
                + _text(type_name)
                + _text("ros2msg")
                + struct.pack("<I", len(data))
                + data,
            )
        channel = Channel(len(self._counts) + 1, topic)
        self._counts[channel.number] = 0
        facts = b"" if qos is None else _text("offered_qos_profiles") + _text(qos)
        declared += _record(
            _CHANNEL,
            struct.pack("<HH", channel.number, self._schemas[type_name])
            + _text(topic)
            + _text("cdr")
            + struct.pack("<I", len(facts))
            + facts,
        )
        self._declarations += declared
        self._append(declared)
        return channel

    def write(self, channel: Channel, time_ns: int, data: bytes | memoryview) -> None:
        """Add a message: bytes in CDR, and the time, ns."""
        self._index[channel.number].append((time_ns, len(self._chunk)))
        count = self._counts[channel.number]
        envelope = struct.pack("<HIQQ", channel.number, count & 0xFFFFFFFF, time_ns, time_ns)
        self._chunk += _record(_MESSAGE, envelope + data)
        self._counts[channel.number] += 1

    def write_chunk(self) -> None:
        """Write the buffered messages to the file, if they fill a chunk."""
        if len(self._chunk) >= _CHUNK_BYTES:
            self._put_chunk()

    def close(self) -> None:
        """Write the remaining messages and the summary. A second call does nothing."""
        if self._closed:
            return
        self._closed = True
        try:
            if self._chunk:
                self._put_chunk()
            self._append(self._end())
        finally:
            self._file.close()

    def _put_chunk(self) -> None:
        times = [time_ns for rows in self._index.values() for time_ns, _ in rows]
        first, last, size = min(times), max(times), len(self._chunk)
        self._first_ns, self._last_ns = min(first, self._first_ns), max(last, self._last_ns)
        checksum = zlib.crc32(self._chunk)
        chunk = _record(
            _CHUNK,
            struct.pack("<QQQI", first, last, size, checksum)
            + _text("")
            + struct.pack("<Q", size)
            + bytes(self._chunk),
        )
        piece, offsets = bytearray(chunk), b""
        for number, rows in self._index.items():
            offsets += struct.pack("<HQ", number, self._at + len(piece))
            entries = b"".join(struct.pack("<QQ", *row) for row in sorted(rows))
            piece += _record(_MESSAGE_INDEX, struct.pack("<HI", number, len(entries)) + entries)
        self._chunk_indexes.append(
            struct.pack("<QQQQI", first, last, self._at, len(chunk), len(offsets))
            + offsets
            + struct.pack("<Q", len(piece) - len(chunk))
            + _text("")
            + struct.pack("<QQ", size, size)
        )
        self._append(bytes(piece))
        self._chunk.clear()
        self._index.clear()

    def _end(self) -> bytes:
        """The end of the data, the summary, and the footer."""
        end = _record(_DATA_END, bytes(4))
        counts = b"".join(struct.pack("<HQ", *item) for item in self._counts.items())
        any_message = any(self._counts.values())
        statistics = struct.pack(
            "<QHIIIIQQI",
            sum(self._counts.values()),
            len(self._schemas),
            len(self._counts),
            0,
            0,
            len(self._chunk_indexes),
            self._first_ns if any_message else 0,
            self._last_ns,
            len(counts),
        )
        summary = self._declarations + _record(_STATISTICS, statistics + counts)
        summary += b"".join(_record(_CHUNK_INDEX, index) for index in self._chunk_indexes)
        footer = struct.pack("<QQI", self._at + len(end), 0, 0)
        return end + summary + _record(_FOOTER, footer) + _MAGIC

    def _append(self, piece: bytes) -> None:
        self._file.append(piece)
        self._at += len(piece)


def _record(op: int, data: bytes) -> bytes:
    return struct.pack("<BQ", op, len(data)) + data


def _text(text: str) -> bytes:
    data = text.encode()
    return struct.pack("<I", len(data)) + data
