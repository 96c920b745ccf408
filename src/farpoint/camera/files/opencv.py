"""OpenCV's FileStorage (YAML, XML or JSON) and ROS ``camera_info``: a camera matrix by name."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from farpoint.camera.camera import Camera
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.lens import unsupported_lens
from farpoint.camera.files.matrix import intrinsics_from_matrix
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.pinhole import Pinhole

TITLE = "OpenCV camera matrix"
FIRST_IS_DEFAULT = False

# People name these freely; one of several cameras carries a suffix, the same on both.
SUFFIX = r"_?(\d|left|right|l|r|)"
MATRIX = re.compile(rf"(?:camera_?matrix|intrinsics?(?:_?matrix)?|mtx|k|m){SUFFIX}", re.IGNORECASE)
DISTORTION = re.compile(
    rf"(?:dist(?:ortion)?(?:_?coeff?s?|_?coefficients)?|d){SUFFIX}", re.IGNORECASE
)
SIZES = (("imagewidth", "imageheight"), ("width", "height"), ("cols", "rows"))
SIZE_PAIRS = ("imagesize", "imgsize", "resolution", "size")
PINHOLES = ("plumb_bob", "rational_polynomial", "radtan", "pinhole", "none")


@dataclass(frozen=True)
class _Keys:
    """Where one camera's matrix and distortion stand."""

    matrix: str
    distortion: str | None


def matches(file: CalibrationFile) -> bool:
    """Whether a field is named like a camera matrix and is one or a list."""
    return bool(_cameras(file.fields))


def names(file: CalibrationFile) -> list[str]:
    """The file's own name or its ``camera_name``; of several cameras the keys of the matrices."""
    fields = file.fields
    matrices = [keys.matrix for keys in _cameras(fields)]
    if len(matrices) > 1:
        return matrices
    return [fields.text("camera_name") if "camera_name" in fields else file.path.stem]


def read(file: CalibrationFile, name: str) -> Camera:
    """One camera."""
    fields = file.fields
    cameras = _cameras(fields)
    keys = next((keys for keys in cameras if keys.matrix == name), cameras[0])
    _require_pinhole(fields)
    intrinsics = intrinsics_from_matrix(fields, keys.matrix)
    distortion = () if keys.distortion is None else tuple(fields.numbers(keys.distortion))
    with blame(fields, keys.matrix, distortion=keys.distortion or keys.matrix):
        model = Pinhole(**intrinsics, distortion=distortion)
    return Camera(model=model, size=_size(fields), name=name)


def _cameras(fields: Fields) -> list[_Keys]:
    distortions = {
        hit[1].lower(): key for key in fields.values if (hit := DISTORTION.fullmatch(key))
    }
    return [
        _Keys(key, distortions.get(hit[1].lower()))
        for key, value in fields.values.items()
        if isinstance(value, list | Mapping) and (hit := MATRIX.fullmatch(key))
    ]


def _require_pinhole(fields: Fields) -> None:
    if "distortion_model" in fields and fields.text("distortion_model").lower() not in (
        "",
        *PINHOLES,
    ):
        raise unsupported_lens(fields, "distortion_model", PINHOLES)
    for flag in ("fisheye_model", "xi"):
        if flag in fields and fields.number(flag) != 0:
            model = "fisheye" if flag == "fisheye_model" else "omnidirectional"
            raise fields.error(flag, f"the lens model {model!r} is not supported; expected pinhole")


def _size(fields: Fields) -> tuple[int, int] | None:
    plain = {key.replace("_", "").lower(): key for key in fields.values}
    for width, height in SIZES:
        if width in plain and height in plain:
            return fields.size(plain[width], plain[height])
    pair = next((plain[key] for key in SIZE_PAIRS if key in plain), None)
    return None if pair is None else fields.size_pair(pair)
