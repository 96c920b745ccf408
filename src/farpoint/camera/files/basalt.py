"""Basalt's ``calibration.json``: a list of cameras under ``value0``."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from farpoint.camera.camera import Camera
from farpoint.camera.double_sphere import DoubleSphere
from farpoint.camera.extended_unified import ExtendedUnified
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.lens import unsupported_lens
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.files.understood import refuse_unread
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.camera.model import CameraModel
from farpoint.camera.pinhole import Pinhole

TITLE = "Basalt calibration"
FIRST_IS_DEFAULT = False

# Keys of the list. Early versions of Basalt, and its simulator, write the second.
LISTS = ("intrinsics", "cam.intrinsics")
KINDS = ("camera_type", "cam_type")


def _pinhole_radtan(**values: float) -> Pinhole:
    intrinsics = {name: values.pop(name) for name in ("fx", "fy", "cx", "cy")}
    return Pinhole(**intrinsics, distortion=tuple(values.values()))


def _unified(**values: float) -> ExtendedUnified:
    return ExtendedUnified(**values, beta=1.0)


# Parameters of each lens after fx fy cx cy, named in a group or numbered p1, p2 ...
LENSES: dict[str, tuple[Callable[..., CameraModel], tuple[str, ...]]] = {
    "pinhole": (Pinhole, ()),
    "pinhole-radtan8": (_pinhole_radtan, ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")),
    "kb4": (KannalaBrandt, ("k1", "k2", "k3", "k4")),
    "eucm": (ExtendedUnified, ("alpha", "beta")),
    "ucm": (_unified, ("alpha",)),
    "ds": (DoubleSphere, ("xi", "alpha")),
}


def matches(file: CalibrationFile) -> bool:
    """Whether ``value0`` holds a list of intrinsics."""
    value = file.fields.values.get("value0")
    return isinstance(value, Mapping) and any(isinstance(value.get(key), list) for key in LISTS)


def names(file: CalibrationFile) -> list[str]:
    """Names ``cam0``, ``cam1`` and so on, because the file has no names."""
    return [f"cam{index}" for index in range(len(_cameras(file)))]


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera of this name."""
    index = int(name.removeprefix("cam"))
    camera = _cameras(file)[index]
    key = camera.first(*KINDS) or KINDS[0]
    kind = camera.text(key).lower()
    if kind not in LENSES:
        raise unsupported_lens(camera, key, LENSES)
    found = Camera(model=_lens(camera, kind), size=_size(file, camera, index), name=name)
    refuse_unread(camera)
    return found


def _lens(camera: Fields, kind: str) -> CameraModel:
    make, extra = LENSES[kind]
    names = ("fx", "fy", "cx", "cy", *extra)
    numbered = ("fx", "fy", "cx", "cy", *(f"p{index}" for index, _ in enumerate(extra, start=1)))
    named = "intrinsics" in camera
    fields = camera.group("intrinsics") if named else camera
    keys = names if named else numbered
    values = {name: fields.number(key) for name, key in zip(names, keys, strict=True)}
    with blame(fields, "intrinsics", **dict(zip(names, keys, strict=True))):
        return make(**values)


def _cameras(file: CalibrationFile) -> list[Fields]:
    fields = file.fields.group("value0")
    key = fields.first(*LISTS) or LISTS[0]
    cameras = fields.values[key]
    if not cameras:
        raise fields.error(key, "expected at least one camera")
    return [
        Fields(
            camera if isinstance(camera, Mapping) else {},
            file.path,
            f"{fields.place(key)}[{index}].",
        )
        for index, camera in enumerate(cameras)
    ]


def _size(file: CalibrationFile, camera: Fields, index: int) -> tuple[int, int] | None:
    if "width" in camera:
        return camera.size("width", "height")
    fields = file.fields.group("value0")
    if "resolution" not in fields:
        return None
    sizes = fields.numbers("resolution", (2 * len(_cameras(file)),))
    place = f"resolution[{index}]"
    pair = Fields({place: sizes[2 * index : 2 * index + 2]}, file.path, fields.within)
    return pair.size_pair(place)
