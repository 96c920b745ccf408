"""Camera files of rpg_vikit, which SVO and FAST-LIVO use: keys such as ``cam_fx``."""

from __future__ import annotations

import re
from collections.abc import Mapping

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

KEY = "cam_model"
FOCAL = ("cam_fx", "cam_fy", "cam_cx", "cam_cy")
LENS = re.compile(rf"cam_.*|{LENS_WORDS.pattern}", re.IGNORECASE)
RELATIVE = "atan"
# How many of the coefficients cam_d0 ... belong to each lens.
COEFFICIENTS = {
    "pinhole": 5,
    "pinholeradialtangential": 4,
    "pinholenodistortion": 0,
    "pinholeequidistant": 4,
    "pinholeatan": 1,
    RELATIVE: 1,
}


def matches(file: CalibrationFile) -> bool:
    """Whether ``cam_model`` stands beside ``cam_width`` or ``cam_fx``, or in a group."""
    return bool(_cameras(file))


def names(file: CalibrationFile) -> list[str]:
    """The file's own name, or those of the groups."""
    return list(_cameras(file))


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera of the images as recorded: how ``scale`` would shrink them is not looked at."""
    camera = _cameras(file)[name]
    kind = camera.text(KEY).lower()
    if kind not in COEFFICIENTS:
        raise unsupported_lens(camera, KEY, COEFFICIENTS)
    keys = tuple(f"cam_d{index}" for index in range(COEFFICIENTS[kind]))
    known = (KEY, "cam_width", "cam_height", "cam_name", *FOCAL, *keys)
    refuse_others(camera, known, only=LENS)
    size = camera.size("cam_width", "cam_height")
    if size is None:
        raise camera.error("cam_width", "the field is missing")
    with blame(camera, KEY, **{key.removeprefix("cam_"): key for key in FOCAL}, omega="cam_d0"):
        return Camera(model=_lens(camera, kind, keys, size), size=size, name=name)


def _cameras(file: CalibrationFile) -> dict[str, Fields]:
    fields = file.fields
    if _is_camera(fields.values):
        return {file.path.stem: fields}
    return {
        key: fields.group(key)
        for key, value in fields.values.items()
        if isinstance(value, Mapping) and _is_camera(value)
    }


def _is_camera(values: Mapping[str, object]) -> bool:
    return KEY in values and any(key in values for key in ("cam_width", *FOCAL))


def _lens(camera: Fields, kind: str, keys: tuple[str, ...], size: tuple[int, int]) -> CameraModel:
    fx, fy, cx, cy = (camera.number(key) for key in FOCAL)
    if kind == RELATIVE:
        # Relative to the image, with the half pixel that PTAM's model takes from the centre.
        fx, fy, cx, cy = fx * size[0], fy * size[1], cx * size[0] - 0.5, cy * size[1] - 0.5
    elif 0 < fx < 10:
        raise camera.error("cam_fx", f"expected pixels, got {fx:g}")
    numbers = [camera.number(key) if key in camera else 0.0 for key in keys]
    if kind in (RELATIVE, "pinholeatan"):
        if numbers[0] == 0.0:
            return Pinhole(fx=fx, fy=fy, cx=cx, cy=cy)
        return Arctangent(fx=fx, fy=fy, cx=cx, cy=cy, omega=numbers[0])
    if kind == "pinholeequidistant":
        k1, k2, k3, k4 = numbers
        return KannalaBrandt(fx=fx, fy=fy, cx=cx, cy=cy, k1=k1, k2=k2, k3=k3, k4=k4)
    distortion = tuple(numbers) if any(numbers) else ()
    return Pinhole(fx=fx, fy=fy, cx=cx, cy=cy, distortion=distortion)
