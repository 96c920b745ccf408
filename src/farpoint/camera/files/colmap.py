"""COLMAP's ``cameras.txt`` and ``cameras.bin``."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass

from farpoint.camera.camera import Camera
from farpoint.camera.files.colmap_lens import PARAMETERS, lens_of_colmap
from farpoint.camera.files.fields import Fields
from farpoint.camera.files.source import CalibrationFile
from farpoint.errors import InputError

TITLE = "COLMAP cameras"
FIRST_IS_DEFAULT = False

LINE = re.compile(r"(?P<name>\d+)\s+(?P<model>[A-Z][A-Z_]+)\s+(?P<rest>\S.*)")
COUNT, HEAD = struct.Struct("<Q"), struct.Struct("<iiQQ")
MODELS = tuple(PARAMETERS)
LARGEST_SIDE_PX = 1 << 20


@dataclass(frozen=True)
class _Record:
    """One camera of the file: its lens model, image size and parameters."""

    model: str
    size: list[object]
    parameters: list[object]


def matches(file: CalibrationFile) -> bool:
    """Whether the first camera is written as ``1 OPENCV 640 480 ...`` or in the binary format."""
    if file.lines:
        return LINE.fullmatch(file.lines[0]) is not None
    if len(file.data) < COUNT.size + HEAD.size:
        return False
    (count,) = COUNT.unpack_from(file.data)
    _, model, *size = HEAD.unpack_from(file.data, COUNT.size)
    return (
        0 < count < len(file.data)
        and 0 <= model < len(MODELS)
        and all(0 < side < LARGEST_SIDE_PX for side in size)
    )


def names(file: CalibrationFile) -> list[str]:
    """The identifiers of the cameras."""
    return list(_records(file))


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera of this name, with the principal point shifted by -0.5 px, as OpenCV counts."""
    record = _records(file)[name]
    fields = Fields(
        {name: record.parameters, f"{name} size": record.size}, file.path, within="camera "
    )
    return Camera(
        model=lens_of_colmap(fields, name, record.model),
        size=fields.size_pair(f"{name} size"),
        name=name,
    )


def _records(file: CalibrationFile) -> dict[str, _Record]:
    return _from_text(file) if file.lines else _from_bytes(file)


def _from_text(file: CalibrationFile) -> dict[str, _Record]:
    records = {}
    for line in file.lines:
        found = LINE.fullmatch(line)
        if found is None:
            raise InputError(
                f"expected CAMERA_ID MODEL WIDTH HEIGHT PARAMS, got {line[:40]!r}",
                file=file.path,
                field="camera",
            )
        values: list[object] = [*found["rest"].split()]
        records[found["name"]] = _Record(found["model"], values[:2], values[2:])
    return records


def _from_bytes(file: CalibrationFile) -> dict[str, _Record]:
    (count,) = COUNT.unpack_from(file.data)
    records, at = {}, COUNT.size
    for index in range(count):
        try:
            name, model, width, height = HEAD.unpack_from(file.data, at)
            parameters = struct.Struct(f"<{len(PARAMETERS[MODELS[model]])}d")
            values = parameters.unpack_from(file.data, at + HEAD.size)
        except (struct.error, IndexError):
            raise InputError(
                f"is cut short or damaged; expected {count} cameras",
                file=file.path,
                field=f"camera number {index + 1}",
            ) from None
        records[str(name)] = _Record(MODELS[model], [width, height], list(values))
        at += HEAD.size + parameters.size
    return records
