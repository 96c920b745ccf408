"""Calibrations of Bouguet's MATLAB toolbox: ``fc``, ``cc`` and ``kc``, as ``Calib_Results.m`` or
JSON.
"""

from __future__ import annotations

import re

from farpoint.camera.camera import Camera
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.files.understood import refuse_unread
from farpoint.camera.pinhole import Pinhole

TITLE = "Bouguet's calibration toolbox"
FIRST_IS_DEFAULT = False

ASSIGNMENT = re.compile(r"(?m)^[ \t]*([A-Za-z]\w*)[ \t]*=[ \t]*(\[[^\]]*\]|[-+.\deE]+)[ \t]*;")
FOCAL = re.compile(r"fc(_left|_right|)")
# The toolbox prints three standard deviations.
ERRORS_PER_SIGMA = 3.0


def matches(file: CalibrationFile) -> bool:
    """Whether a script assigns ``fc`` and ``cc``, or the file has fields with these names."""
    return bool(_sides(_fields(file)))


def names(file: CalibrationFile) -> list[str]:
    """The name of the file for a single camera, or ``left`` and ``right`` of a stereo pair."""
    sides = _sides(_fields(file))
    return [file.path.stem] if sides == [""] else [side.removeprefix("_") for side in sides if side]


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera. The toolbox counts pixels from 0 and uses OpenCV's formula.

    ``kc`` must have five numbers. The fisheye version and the first versions of the toolbox wrote
    four numbers, which can belong to a fisheye or to a pinhole. A file with four numbers is
    refused.
    """
    fields = _fields(file)
    side = f"_{name}" if f"fc_{name}" in fields else ""
    keys = {key: f"{key}{side}" for key in ("fc", "cc", "kc", "alpha_c")}
    fx, fy = fields.numbers(keys["fc"], (2,))
    cx, cy = fields.numbers(keys["cc"], (2,))
    if keys["alpha_c"] in fields and fields.number(keys["alpha_c"]):
        raise fields.error(keys["alpha_c"], "a pinhole with skew is not supported; expected 0")
    distortion = fields.numbers(keys["kc"], (5,)) if keys["kc"] in fields else []
    at = dict.fromkeys(("fx", "fy"), keys["fc"])
    with blame(fields, keys["cc"], distortion=keys["kc"], **at):
        model = Pinhole(fx=fx, fy=fy, cx=cx, cy=cy, distortion=tuple(distortion))
    camera = Camera(model=model, size=fields.size("nx", "ny"), name=name)
    camera = _with_errors(camera, fields, keys)
    fields.read.update(f"{key}{other}" for key in keys for other in ("_left", "_right"))
    refuse_unread(fields)
    return camera


def _with_errors(camera: Camera, fields: Fields, keys: dict[str, str]) -> Camera:
    """The camera with the standard deviations of its parameters, if the file has deviations."""
    counts = {f"{keys[key]}_error": count for key, count in (("fc", 2), ("cc", 2), ("kc", 5))}
    if not all(key in fields for key in counts):
        return camera
    errors = [error for key, count in counts.items() for error in fields.numbers(key, (count,))]
    if not any(errors):
        return camera
    sigmas = [error / ERRORS_PER_SIGMA for error in errors]
    with blame(fields, next(iter(counts))):
        return camera.with_parameter_sigmas(
            dict(zip(camera.model.parameters, sigmas, strict=False))
        )


def _fields(file: CalibrationFile) -> Fields:
    """Fields of a JSON or YAML file, or the values that a MATLAB script assigns."""
    if _sides(file.fields):
        return file.fields
    lines = (line.split("%", 1)[0] for line in file.text.splitlines())
    values = {
        name: value.strip("[]").replace(";", " ")
        for name, value in ASSIGNMENT.findall("\n".join(lines))
    }
    return Fields(values, file.path)


def _sides(fields: Fields) -> list[str]:
    """Suffixes of the field names of each camera; a single camera has an empty suffix."""
    hits = (FOCAL.fullmatch(str(key)) for key in fields.values)
    return [hit[1] for hit in hits if hit and f"cc{hit[1]}" in fields]
