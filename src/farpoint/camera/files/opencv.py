"""OpenCV's FileStorage (YAML, XML or JSON) and ROS ``camera_info``: a camera matrix by name."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from farpoint.camera.camera import Camera
from farpoint.camera.files.deviations import with_deviations
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.lens import unsupported_lens
from farpoint.camera.files.matrix import intrinsics_from_matrix, skew_of_matrix
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.camera.model import CameraModel
from farpoint.camera.pinhole import Pinhole
from farpoint.camera.unified import Unified

TITLE = "OpenCV camera matrix"
FIRST_IS_DEFAULT = False

# People name these freely; one of several cameras carries a suffix, the same on both.
SUFFIX = r"_?(\d|left|right|l|r|)"
MATRIX = re.compile(rf"(?:camera_?matrix|intrinsics?(?:_?matrix)?|mtx|k|m){SUFFIX}", re.IGNORECASE)
DISTORTION = re.compile(
    rf"(?:dist(?:ortion)?(?:_?coeff?s?|_?coefficients)?|d){SUFFIX}", re.IGNORECASE
)
SIZES = (("imagewidth", "imageheight"), ("width", "height"), ("cols", "rows"))
SIZE_PAIRS = ("imagesize", "imgsize", "resolution", "size", "cameraresolution")
PINHOLES = ("plumb_bob", "rational_polynomial", "radtan", "pinhole", "none")
FISHEYES = ("equidistant", "fisheye")


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
    camera = Camera(model=_lens(fields, keys), size=_size(fields), name=name)
    return with_deviations(camera, fields, keys.matrix, keys.distortion)


def _lens(fields: Fields, keys: _Keys) -> CameraModel:
    distortion = () if keys.distortion is None else tuple(fields.numbers(keys.distortion))
    with blame(fields, keys.matrix, distortion=keys.distortion or keys.matrix, xi="xi"):
        if "xi" in fields:
            (xi,) = fields.numbers("xi", (1,))
            intrinsics = intrinsics_from_matrix(fields, keys.matrix, skewed=True)
            skew = skew_of_matrix(fields, keys.matrix)
            return Unified(**intrinsics, xi=xi, distortion=distortion, skew=skew)
        intrinsics = intrinsics_from_matrix(fields, keys.matrix)
        if _is_fisheye(fields):
            at = keys.distortion or "distortion_coefficients"
            k1, k2, k3, k4 = fields.numbers(at, (4,))
            return KannalaBrandt(**intrinsics, k1=k1, k2=k2, k3=k3, k4=k4)
        return Pinhole(**intrinsics, distortion=distortion)


def _cameras(fields: Fields) -> list[_Keys]:
    distortions = {
        hit[1].lower(): key for key in fields.values if (hit := DISTORTION.fullmatch(key))
    }
    return [
        _Keys(key, distortions.get(hit[1].lower()))
        for key, value in fields.values.items()
        if isinstance(value, list | Mapping) and (hit := MATRIX.fullmatch(key))
    ]


def _is_fisheye(fields: Fields) -> bool:
    """Whether the coefficients are a fisheye's; an InputError for a lens that is unknown here."""
    if "fisheye_model" in fields and fields.number("fisheye_model") != 0:
        return True
    named = fields.text("distortion_model").lower() if "distortion_model" in fields else ""
    if named not in ("", *PINHOLES, *FISHEYES):
        raise unsupported_lens(fields, "distortion_model", (*PINHOLES, *FISHEYES))
    return named in FISHEYES


def _size(fields: Fields) -> tuple[int, int] | None:
    plain = {key.replace("_", "").lower(): key for key in fields.values}
    for width, height in SIZES:
        if width in plain and height in plain:
            return fields.size(plain[width], plain[height])
    pair = next((plain[key] for key in SIZE_PAIRS if key in plain), None)
    return None if pair is None else fields.size_pair(pair)
