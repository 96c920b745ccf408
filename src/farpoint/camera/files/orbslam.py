"""Settings of ORB-SLAM 2 and 3, with flat keys such as ``Camera.fx`` or ``Camera1.fx``."""

from __future__ import annotations

import re

from farpoint.camera.camera import Camera
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.lens import unsupported_lens
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.files.understood import refuse_contradiction, refuse_others
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.camera.model import CameraModel
from farpoint.camera.pinhole import Pinhole

TITLE = "ORB-SLAM settings"
FIRST_IS_DEFAULT = False

KEY = re.compile(r"(Camera\d?)\.(fx|fy|cx|cy|type|k1)")
# Rectified images have no distortion left, and their files give no coefficients.
RECTIFIED = "Rectified"
PINHOLES = ("PinHole", RECTIFIED)
FISHEYE = "KannalaBrandt8"
NOT_OF_THE_LENS = (
    *("type", "width", "height", "newWidth", "newHeight", "fps", "RGB", "bf", "bFishEye"),
    *("overlappingBegin", "overlappingEnd", "lappingBegin", "lappingEnd", "imageScale", "imu"),
)


def matches(file: CalibrationFile) -> bool:
    """Whether a key like ``Camera.fx`` is present."""
    return any(KEY.fullmatch(key) for key in file.fields.values)


def names(file: CalibrationFile) -> list[str]:
    """``Camera1`` and ``Camera2`` for version 3; the name of the file for the single camera of
    version 2.
    """
    found = [KEY.fullmatch(key) for key in file.fields.values]
    numbered = {hit[1]: None for hit in found if hit and hit[1] != "Camera"}
    return list(numbered) or [file.path.stem]


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera of this name."""
    fields = file.fields
    prefix = name if f"{name}.fx" in fields else "Camera"
    size = fields.size("Camera.width", "Camera.height")
    camera = Camera(model=_lens(fields, prefix), size=size, name=name)
    of_camera = {key: value for key, value in fields.values.items() if key.startswith(prefix + ".")}
    known = (*(f"{prefix}.{key}" for key in NOT_OF_THE_LENS), *fields.read)
    refuse_others(Fields(of_camera, fields.file), known)
    return camera


def _lens(fields: Fields, prefix: str) -> CameraModel:
    kind = fields.text("Camera.type") if "Camera.type" in fields else PINHOLES[0]
    if kind not in (*PINHOLES, FISHEYE):
        raise unsupported_lens(fields, "Camera.type", (*PINHOLES, FISHEYE))
    fx, fy, cx, cy = (fields.number(f"{prefix}.{key}") for key in ("fx", "fy", "cx", "cy"))
    with blame(fields, prefix):
        if kind == FISHEYE:
            k1, k2, k3, k4 = (fields.number(f"{prefix}.k{index}") for index in (1, 2, 3, 4))
            return KannalaBrandt(fx=fx, fy=fy, cx=cx, cy=cy, k1=k1, k2=k2, k3=k3, k4=k4)
        return Pinhole(fx=fx, fy=fy, cx=cx, cy=cy, distortion=_distortion(fields, prefix))


def _distortion(fields: Fields, prefix: str) -> tuple[float, ...]:
    """Coefficients in OpenCV's order. Missing coefficients are zero. The result is empty if the
    file has no coefficients.
    """
    order = [f"{prefix}.{name}" for name in ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")]
    present = [index for index, key in enumerate(order) if key in fields]
    if not present:
        return ()
    if "Camera.type" in fields and fields.text("Camera.type") == RECTIFIED:
        for index in present:
            refuse_contradiction(fields, "Camera.type", order[index])
    count = next(count for count in (4, 5, 8) if count > present[-1])
    return tuple(fields.number(key) if key in fields else 0.0 for key in order[:count])
