"""nerfstudio's and instant-ngp's ``transforms.json``."""

from __future__ import annotations

import math
from collections.abc import Mapping

from farpoint.camera.camera import Camera
from farpoint.camera.equirectangular import Equirectangular
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.lens import unsupported_lens
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.files.understood import refuse_unread
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.camera.model import CameraModel
from farpoint.camera.pinhole import Pinhole

TITLE = "nerfstudio transforms.json"
FIRST_IS_DEFAULT = False

FOCAL = ("fl_x", "camera_angle_x")
PINHOLES = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE")
FISHEYE = "OPENCV_FISHEYE"
SPHERE = "EQUIRECTANGULAR"


def matches(file: CalibrationFile) -> bool:
    """Whether the file has a list of frames, or a focal length under nerfstudio's name."""
    fields = file.fields
    return isinstance(fields.values.get("frames"), list) or fields.first(*FOCAL) is not None


def names(file: CalibrationFile) -> list[str]:
    """The name of the file; if every frame has its own camera, the names of the images."""
    return list(_frames(file)) or [file.path.stem]


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera. As in COLMAP's files, the centre of the first pixel is at (0.5, 0.5)."""
    whole = file.fields
    fields = _frames(file).get(name, whole)
    size = fields.size("w", "h")
    camera = Camera(model=_lens(fields, whole, size), size=size, name=name)
    refuse_unread(fields)
    return camera


def _frames(file: CalibrationFile) -> dict[str, Fields]:
    """The frames with a focal length of their own, by the name of their image."""
    frames = file.fields.values.get("frames")
    return {
        str(frame.get("file_path", index)): Fields(frame, file.path, f"frames[{index}].")
        for index, frame in enumerate(frames if isinstance(frames, list) else [])
        if isinstance(frame, Mapping) and FOCAL[0] in frame
    }


def _lens(fields: Fields, whole: Fields, size: tuple[int, int] | None) -> CameraModel:
    named = fields if "camera_model" in fields else whole
    kind = named.text("camera_model") if "camera_model" in named else PINHOLES[0]
    if kind not in (*PINHOLES, FISHEYE, SPHERE):
        raise unsupported_lens(named, "camera_model", (*PINHOLES, FISHEYE, SPHERE))
    if kind == SPHERE:
        if size is None:
            raise fields.error("w", "the field is missing")
        fields.read.update(fields.values)  # nerfstudio ignores perspective fields here
        return Equirectangular(width=size[0], height=size[1])
    fx = _focal(fields, "x", size, 0)
    fy = _focal(fields, "y", size, 1) if fields.first("fl_y", "camera_angle_y") else fx
    cx, cy = _centre(fields, "cx", size, 0), _centre(fields, "cy", size, 1)
    k1, k2, k3, k4, p1, p2 = (
        fields.number(key) if key in fields else 0.0 for key in ("k1", "k2", "k3", "k4", "p1", "p2")
    )
    with blame(fields, "camera_model", fx=_focal_key(fields, "x"), fy=_focal_key(fields, "y")):
        if kind == FISHEYE:
            return KannalaBrandt(fx=fx, fy=fy, cx=cx, cy=cy, k1=k1, k2=k2, k3=k3, k4=k4)
        if k4:
            raise fields.error("k4", f"expected 0 for a pinhole, got {k4:g}")
        distortion = (k1, k2, p1, p2, k3) if any((k1, k2, k3, p1, p2)) else ()
        return Pinhole(fx=fx, fy=fy, cx=cx, cy=cy, distortion=distortion)


def _focal_key(fields: Fields, axis: str) -> str:
    return fields.first(f"fl_{axis}", f"camera_angle_{axis}") or f"fl_{axis}"


def _focal(fields: Fields, axis: str, size: tuple[int, int] | None, side: int) -> float:
    """The focal length, px, given directly or computed from the angle across the image."""
    key = _focal_key(fields, axis)
    if key.startswith("fl_"):
        return fields.number(key)
    if size is None:
        raise fields.error("w", f"the field is missing; {key} has no meaning without it")
    return 0.5 * size[side] / math.tan(0.5 * fields.number(key))


def _centre(fields: Fields, key: str, size: tuple[int, int] | None, side: int) -> float:
    if key in fields or size is None:
        return fields.number(key) - 0.5
    return 0.5 * size[side] - 0.5
