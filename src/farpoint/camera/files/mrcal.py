"""mrcal's ``.cameramodel``: a Python dictionary, of which only the necessary fields are parsed."""

from __future__ import annotations

import math
import re

from farpoint.camera.camera import Camera
from farpoint.camera.equirectangular import Equirectangular
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.lens import unsupported_lens
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.files.understood import LENS_WORDS, refuse_others
from farpoint.camera.model import CameraModel
from farpoint.camera.pinhole import Pinhole
from farpoint.camera.unified import Unified

TITLE = "mrcal camera model"
FIRST_IS_DEFAULT = False

MODEL = re.compile(r"""["']lens_?model["']\s*:\s*b?["']LENSMODEL_""")
FIELD = re.compile(r"""["'](?P<key>\w+)["']\s*:\s*b?(?P<value>\[[^][]*\]|"[^"]*"|'[^']*')?""")
# Placeholder of a value that is neither a text nor a flat list.
NOT_PARSED = "..."
MODEL_KEYS = ("lensmodel", "lens_model")
KNOWN = (*MODEL_KEYS, "intrinsics", "imagersize")
STEREOGRAPHIC, SPHERE = "LENSMODEL_STEREOGRAPHIC", "LENSMODEL_LONLAT"
# How many coefficients of distortion follow the focal lengths and the principal point.
COEFFICIENTS = {
    "LENSMODEL_PINHOLE": 0,
    "LENSMODEL_OPENCV4": 4,
    "LENSMODEL_OPENCV5": 5,
    "LENSMODEL_OPENCV8": 8,
    "LENSMODEL_OPENCV12": 12,
    STEREOGRAPHIC: 0,
    SPHERE: 0,
}


def matches(file: CalibrationFile) -> bool:
    """Whether the file has a ``lensmodel`` with a name of the kind that mrcal uses."""
    return MODEL.search(file.text) is not None


def names(file: CalibrationFile) -> list[str]:
    """The name of the file, for its only camera."""
    return [file.path.stem]


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera. The centres of pixels have whole-number coordinates."""
    fields = _fields(file)
    key = fields.first(*MODEL_KEYS) or MODEL_KEYS[0]
    kind = fields.text(key)
    if kind not in COEFFICIENTS:
        raise unsupported_lens(fields, key, COEFFICIENTS)
    refuse_others(fields, KNOWN, only=LENS_WORDS)
    size = fields.size_pair("imagersize")
    if size is None:
        raise fields.error("imagersize", "the field is missing")
    numbers = fields.numbers("intrinsics", (4 + COEFFICIENTS[kind],))
    with blame(fields, "intrinsics"):
        return Camera(model=_lens(fields, kind, numbers, size), size=size, name=name)


def _fields(file: CalibrationFile) -> Fields:
    values = {
        found["key"]: (found["value"] or NOT_PARSED).strip("[]\"'").replace("\n", " ").strip()
        for found in FIELD.finditer("\n".join(file.lines))
    }
    return Fields(values, file.path)


def _lens(fields: Fields, kind: str, numbers: list[float], size: tuple[int, int]) -> CameraModel:
    fx, fy, cx, cy, *distortion = numbers
    if kind == SPHERE:
        return _whole_sphere(fields, numbers, size)
    if kind == STEREOGRAPHIC:
        # Stereographic image height: 2 tan(angle / 2) = 2 R / (Z + d), focal lengths.
        return Unified(fx=2.0 * fx, fy=2.0 * fy, cx=cx, cy=cy, xi=1.0)
    return Pinhole(fx=fx, fy=fy, cx=cx, cy=cy, distortion=tuple(distortion))


def _whole_sphere(fields: Fields, numbers: list[float], size: tuple[int, int]) -> CameraModel:
    width, height = size
    whole = [width / (2.0 * math.pi), height / math.pi, 0.5 * (width - 1), 0.5 * (height - 1)]
    if any(
        abs(number - expected) > 1e-6 * width
        for number, expected in zip(numbers, whole, strict=True)
    ):
        words = " ".join(f"{number:.6f}" for number in whole)
        raise fields.error("intrinsics", f"expected those of the whole sphere, {words}")
    return Equirectangular(width=width, height=height)
