"""Camera files of rpg_vikit, used by SVO and FAST-LIVO, with keys such as ``cam_fx``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from farpoint.camera.arctangent import Arctangent
from farpoint.camera.camera import Camera
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.lens import unsupported_lens
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.files.understood import LENS_WORDS, refuse_others
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.camera.model import CameraModel
from farpoint.camera.pinhole import Pinhole

TITLE = "rpg_vikit camera"
FIRST_IS_DEFAULT = False

PREFIX = "cam_"
FOCAL = ("fx", "fy", "cx", "cy")
SIZE = ("width", "height")
# ROS 2 keeps parameters below this key; there the prefix may be missing.
ROS = "ros__parameters"
DEEPEST = 4
# A smaller number is a focal length relative to the size of the image.
LEAST_FOCAL_PX = 10.0
LENS = re.compile(rf"{PREFIX}.*|{LENS_WORDS.pattern}|d\d+", re.IGNORECASE)
RELATIVE = "atan"
# Coefficients of each lens; a missing one is zero. Only d0 ... have the prefix of the keys.
COEFFICIENTS = {
    "pinhole": ("d0", "d1", "d2", "d3", "d4"),
    "pinholeradialtangential": ("d0", "d1", "d2", "d3"),
    "pinholenodistortion": (),
    "pinholeequidistant": ("d0", "d1", "d2", "d3"),
    "equidistantcamera": ("k1", "k2", "k3", "k4"),
    "pinholeatan": ("d0",),
    RELATIVE: ("d0",),
}


@dataclass(frozen=True)
class _Camera:
    """A group of fields, and the prefix of the keys in this group."""

    fields: Fields
    prefix: str

    def key(self, name: str) -> str:
        return name if name.startswith("k") else f"{self.prefix}{name}"

    def number(self, name: str) -> float:
        return self.fields.number(self.key(name))


def matches(file: CalibrationFile) -> bool:
    """Whether the file or a group has ``cam_model`` together with ``cam_width`` or ``cam_fx``."""
    return bool(_cameras(file))


def names(file: CalibrationFile) -> list[str]:
    """The name of the file, or the names of the groups."""
    return list(_cameras(file))


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera of the recorded images; the field ``scale`` is not applied."""
    camera = _cameras(file)[name]
    fields = camera.fields
    kind = fields.text(camera.key("model")).lower()
    if kind not in COEFFICIENTS:
        raise unsupported_lens(fields, camera.key("model"), COEFFICIENTS)
    names = ("model", "name", *SIZE, *FOCAL, *COEFFICIENTS[kind])
    refuse_others(fields, [camera.key(name) for name in names], only=LENS)
    size = fields.size(*map(camera.key, SIZE))
    if size is None:
        raise fields.error(camera.key("width"), "the field is missing")
    keys = {name: camera.key(name) for name in FOCAL}
    with blame(fields, camera.key("model"), **keys, omega=camera.key("d0")):
        return Camera(model=_lens(camera, kind, size), size=size, name=name)


def _cameras(file: CalibrationFile) -> dict[str, _Camera]:
    found: dict[str, _Camera] = {}
    _gather(file.fields, file.path.stem, found)
    return found


def _gather(fields: Fields, name: str, found: dict[str, _Camera], depth: int = 0) -> None:
    """Add the cameras of a group and of its subgroups, each under the name of its group."""
    if f"{PREFIX}model" in fields and fields.first(f"{PREFIX}width", f"{PREFIX}fx"):
        found[name if name not in found else fields.within.rstrip(".")] = _Camera(fields, PREFIX)
    elif ROS in fields.within and all(key in fields for key in ("model", "width", "fx")):
        found[name if name not in found else fields.within.rstrip(".")] = _Camera(fields, "")
    elif depth < DEEPEST:
        for key, value in fields.values.items():
            if isinstance(value, Mapping):
                _gather(fields.group(key), name if key == ROS else key, found, depth + 1)


def _lens(camera: _Camera, kind: str, size: tuple[int, int]) -> CameraModel:
    fx, fy, cx, cy = (camera.number(name) for name in FOCAL)
    if kind == RELATIVE:
        # Relative to the image. PTAM's model subtracts half a pixel from the principal point.
        fx, fy, cx, cy = fx * size[0], fy * size[1], cx * size[0] - 0.5, cy * size[1] - 0.5
    elif 0 < fx < LEAST_FOCAL_PX:
        raise camera.fields.error(camera.key("fx"), f"expected pixels, got {fx:g}")
    numbers = [
        camera.number(name) if camera.key(name) in camera.fields else 0.0
        for name in COEFFICIENTS[kind]
    ]
    if kind in (RELATIVE, "pinholeatan"):
        if numbers[0] == 0.0:
            return Pinhole(fx=fx, fy=fy, cx=cx, cy=cy)
        return Arctangent(fx=fx, fy=fy, cx=cx, cy=cy, omega=numbers[0])
    if kind.startswith(("pinholeequidistant", "equidistant")):
        k1, k2, k3, k4 = numbers
        return KannalaBrandt(fx=fx, fy=fy, cx=cx, cy=cy, k1=k1, k2=k2, k3=k3, k4=k4)
    distortion = tuple(numbers) if any(numbers) else ()
    return Pinhole(fx=fx, fy=fy, cx=cx, cy=cy, distortion=distortion)
