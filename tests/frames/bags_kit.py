"""Bags of every kind, written by rosbags, and MCAP files as Foxglove's tools write them."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

Kind = Literal["ros1", "sqlite3", "mcap"]
KINDS: tuple[Kind, ...] = ("ros1", "sqlite3", "mcap")

_FOXGLOVE_VIDEO = """\
builtin_interfaces/Time timestamp
string frame_id
uint8[] data
string format
"""

RECORDED_NS = 1_700_000_000 * 10**9
"""When the first message was recorded; headers have times of their own."""


def _stores() -> tuple[Any, Any]:
    stores = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
    for store in stores:
        store.register(get_types_from_msg(_FOXGLOVE_VIDEO, "foxglove_msgs/msg/CompressedVideo"))
    return stores


ROS1, ROS2 = _stores()


@dataclass(frozen=True)
class Sent:
    """A message: its topic, type, time of recording and fields."""

    topic: str
    type_name: str
    recorded_ns: int
    fields: dict[str, Any]


def header(stamp_ns: int, frame_id: str = "camera") -> dict[str, Any]:
    return {"stamp": stamp_ns, "frame_id": frame_id}


def image_message(
    pixels: np.ndarray,
    encoding: str,
    stamp_ns: int,
    *,
    topic: str = "/cam/image_raw",
    padding: int = 0,
    big: bool = False,
    recorded_ns: int | None = None,
) -> Sent:
    """A ``sensor_msgs/Image``, its lines padded by some bytes."""
    height, width = pixels.shape[:2]
    raw = pixels.astype(pixels.dtype.newbyteorder(">" if big else "<"))
    lines = np.ascontiguousarray(raw).view(np.uint8).reshape(height, -1)
    lines = np.pad(lines, ((0, 0), (0, padding)), constant_values=255)
    fields = {
        "header": header(stamp_ns),
        "height": height,
        "width": width,
        "encoding": encoding,
        "is_bigendian": int(big),
        "step": lines.shape[1],
        "data": lines.ravel(),
    }
    return Sent(topic, "sensor_msgs/msg/Image", _recorded(recorded_ns, stamp_ns), fields)


def compressed_message(
    data: bytes, stamp_ns: int, *, topic: str = "/cam/image_raw/compressed", kind: str = "png"
) -> Sent:
    fields = {"header": header(stamp_ns), "format": kind, "data": np.frombuffer(data, np.uint8)}
    return Sent(topic, "sensor_msgs/msg/CompressedImage", _recorded(None, stamp_ns), fields)


def info_message(
    topic: str = "/cam/camera_info",
    *,
    size: tuple[int, int],
    k: Sequence[float],
    d: Sequence[float] = (),
    model: str = "plumb_bob",
    p: Sequence[float] | None = None,
    binning: tuple[int, int] = (0, 0),
    roi: tuple[int, int, int, int] = (0, 0, 0, 0),
    frame_id: str = "camera",
) -> Sent:
    projection = p or [k[0], k[1], k[2], 0.0, k[3], k[4], k[5], 0.0, k[6], k[7], k[8], 0.0]
    region = dict(zip(("x_offset", "y_offset", "width", "height"), roi, strict=True))
    fields = {
        "header": header(1, frame_id),
        "width": size[0],
        "height": size[1],
        "distortion_model": model,
        "d": np.array(d, float),
        "k": np.array(k, float),
        "r": np.eye(3).ravel(),
        "p": np.array(projection, float),
        "binning_x": binning[0],
        "binning_y": binning[1],
        "roi": {**region, "do_rectify": False},
    }
    return Sent(topic, "sensor_msgs/msg/CameraInfo", RECORDED_NS, fields)


def _recorded(recorded_ns: int | None, stamp_ns: int) -> int:
    return RECORDED_NS + stamp_ns if recorded_ns is None else recorded_ns


def build(store: Any, type_name: str, fields: dict[str, Any]) -> Any:
    """A message of a typestore from plain values."""
    kind = store.types[type_name]
    values = {}
    for name, annotation in kind.__annotations__.items():
        if name in ("__msgtype__", "seq"):
            continue
        value = fields.get(name, fields.get(name.lower()))
        values[name] = _value(store, str(annotation), value)
    if "seq" in kind.__annotations__:
        values["seq"] = 0
    return kind(**values)


def _value(store: Any, annotation: str, value: Any) -> Any:
    name = annotation.rpartition(".")[2].strip("'\"")
    if isinstance(value, dict):
        found = next(key for key in store.types if key.endswith(f"/{name.split('__')[-1]}"))
        return build(store, found, value)
    if name.endswith("Time") and isinstance(value, int):
        time = store.types["builtin_interfaces/msg/Time"]
        return time(sec=value // 10**9, nanosec=value % 10**9)
    return value


def write_bag(
    folder: Path,
    kind: Kind,
    messages: Iterable[Sent],
    *,
    name: str = "drive",
    compression: Literal["", "bz2", "lz4", "file", "message", "storage"] = "",
    damage: Any = None,
) -> Path:
    """A bag; ``damage`` may change the bytes of a message, given its number."""
    store = ROS1 if kind == "ros1" else ROS2
    if kind == "ros1":
        path = folder / f"{name}.bag"
        writer: Any = Writer1(path)
        if compression:
            writer.set_compression(
                {"bz2": Writer1.CompressionFormat.BZ2, "lz4": Writer1.CompressionFormat.LZ4}[
                    compression
                ]
            )
    else:
        path = folder / f"{name}-{kind}"
        plugin = StoragePlugin.SQLITE3 if kind == "sqlite3" else StoragePlugin.MCAP
        writer = Writer2(path, version=9, storage_plugin=plugin)
        if compression:
            writer.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
    connections: dict[str, Any] = {}
    with writer:
        for number, sent in enumerate(messages):
            if sent.topic not in connections:
                connections[sent.topic] = writer.add_connection(
                    sent.topic, sent.type_name, typestore=store
                )
            message = build(store, sent.type_name, sent.fields)
            serialize = store.serialize_ros1 if kind == "ros1" else store.serialize_cdr
            data = bytes(serialize(message, sent.type_name))
            if damage is not None:
                data = damage(number, data)
            writer.write(connections[sent.topic], sent.recorded_ns, data)
    return path


def file_of(bag: Path) -> Path:
    """The file of a bag that may be a folder."""
    return bag if bag.is_file() else next(p for p in bag.iterdir() if p.suffix in (".mcap", ".db3"))


def mcap_record(op: int, data: bytes) -> bytes:
    return struct.pack("<BQ", op, len(data)) + data


def _text(text: str) -> bytes:
    return struct.pack("<I", len(text.encode())) + text.encode()


def foxglove_mcap(
    path: Path,
    messages: Sequence[tuple[int, bytes]],
    *,
    type_name: str,
    encoding: str = "protobuf",
    topic: str = "/camera",
    end: bool = True,
    schema: tuple[str, bytes] | None = None,
) -> Path:
    """An MCAP file without a profile, chunks or a summary: messages one after the other."""
    language, definition = schema or (encoding, b"")
    described = struct.pack("<H", 1) + _text(type_name) + _text(language)
    described += struct.pack("<I", len(definition)) + definition
    channel = struct.pack("<HH", 7, 1) + _text(topic) + _text(encoding) + struct.pack("<I", 0)
    parts = [b"\x89MCAP0\r\n", mcap_record(1, _text("") + _text("test"))]
    parts += [mcap_record(3, described), mcap_record(4, channel)]
    parts += [
        mcap_record(5, struct.pack("<HIQQ", 7, 0, time_ns, time_ns) + data)
        for time_ns, data in messages
    ]
    if end:
        parts += [mcap_record(15, bytes(4)), mcap_record(2, bytes(20)), b"\x89MCAP0\r\n"]
    path.write_bytes(b"".join(parts))
    return path


def proto(*fields: tuple[int, Any]) -> bytes:
    """Fields of Protocol Buffers: whole numbers, bytes, texts, or doubles in a list."""
    parts = []
    for number, value in fields:
        if isinstance(value, int):
            parts.append(_varint(number << 3) + _varint(value))
            continue
        if isinstance(value, list):
            value = struct.pack(f"<{len(value)}d", *value)
        data = value.encode() if isinstance(value, str) else value
        parts.append(_varint(number << 3 | 2) + _varint(len(data)) + data)
    return b"".join(parts)


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def proto_stamp(stamp_ns: int) -> bytes:
    return proto((1, stamp_ns // 10**9), (2, stamp_ns % 10**9))


def png(image: np.ndarray) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()
