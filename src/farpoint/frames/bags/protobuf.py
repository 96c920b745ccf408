"""Foxglove's messages in MCAP files, encoded in Protocol Buffers or in JSON.

The field numbers are those of Foxglove's ``.proto`` files, which never change:
https://github.com/foxglove/foxglove-sdk/tree/main/schemas
"""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

__all__ = ["FOXGLOVE_FIELDS", "from_json", "from_protobuf"]

_STAMP = {1: "timestamp"}
FOXGLOVE_FIELDS: dict[str, dict[int, str]] = {
    "RawImage": {
        **_STAMP, 2: "width", 3: "height", 4: "encoding", 5: "step", 6: "data", 7: "frame_id",
    },
    "CompressedImage": {**_STAMP, 2: "data", 3: "format", 4: "frame_id"},
    "CompressedVideo": {**_STAMP, 2: "frame_id", 3: "data", 4: "format"},
    "CameraCalibration": {
        **_STAMP, 2: "width", 3: "height", 4: "distortion_model", 5: "d", 6: "k", 7: "r", 8: "p",
        9: "frame_id",
    },
}  # fmt: skip
"""Field names by field number, for each type without its prefix ``foxglove.``."""

_TEXTS = frozenset({"encoding", "format", "frame_id", "distortion_model"})
_MATRICES = frozenset({"d", "k", "r", "p"})
_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5


def from_protobuf(data: bytes | memoryview, kind: str) -> SimpleNamespace:
    """The fields of a message; an absent field has the default value.

    Raises ValueError if the message is damaged.
    """
    fields = _blank(kind)
    for number, value in _wire(memoryview(data)):
        name = FOXGLOVE_FIELDS[kind].get(number)
        if name is None:
            continue
        if name in _MATRICES:
            packed = struct.pack("<Q", value) if isinstance(value, int) else bytes(value)
            value = [*fields[name], *struct.unpack(f"<{len(packed) // 8}d", packed)]
        elif name in ("width", "height", "step"):
            value = int(value)  # bytes raise TypeError
        elif isinstance(value, int):
            raise ValueError(f"{name} is a number")
        elif name == "timestamp":
            parts = dict(_wire(value))
            value = _stamp(int(parts.get(1, 0)), int(parts.get(2, 0)))
        else:
            value = bytes(value).decode() if name in _TEXTS else bytes(value)
        fields[name] = value
    return SimpleNamespace(**fields)


def from_json(data: bytes | memoryview, kind: str) -> SimpleNamespace:
    """The fields of a message in JSON, whose binary data is in base64."""
    found = json.loads(bytes(data))
    fields = _blank(kind)
    for key, value in found.items():
        name = key.lower()
        if name == "timestamp":
            value = _stamp(int(value["sec"]), int(value.get("nsec", value.get("nanosec", 0))))
        elif name == "data":
            value = base64.b64decode(value, validate=True)
        fields[name] = value
    return SimpleNamespace(**fields)


def _blank(kind: str) -> dict[str, Any]:
    names = FOXGLOVE_FIELDS[kind].values()
    fields: dict[str, Any] = dict.fromkeys(names, 0)
    fields |= {name: "" for name in names if name in _TEXTS}
    fields |= {name: [] for name in names if name in _MATRICES}
    return fields | {"timestamp": _stamp(0, 0), "data": b""}


def _stamp(sec: int, nanosec: int) -> SimpleNamespace:
    return SimpleNamespace(sec=sec, nanosec=nanosec)


def _wire(data: memoryview) -> Iterator[tuple[int, Any]]:
    """Numbers and values of the fields, in the order of the bytes."""
    at = 0
    while at < len(data):
        key, at = _varint(data, at)
        number, kind = key >> 3, key & 7
        if kind == _VARINT:
            value, at = _varint(data, at)
        else:
            if kind == _BYTES:
                size, at = _varint(data, at)
            elif kind in (_FIXED64, _FIXED32):
                size = 8 if kind == _FIXED64 else 4
            else:
                raise ValueError("not a message of Protocol Buffers")
            value, at = data[at : at + size], at + size
            if at > len(data):
                raise ValueError("the message is cut off")
            if kind != _BYTES:
                value = int.from_bytes(value, "little")
        yield number, value


def _varint(data: memoryview, at: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        if at >= len(data):
            raise ValueError("the message is cut off")
        byte, at = data[at], at + 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
    raise ValueError("not a message of Protocol Buffers")
