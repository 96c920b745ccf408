"""Bare numbers: ``fx fy cx cy [k1 k2 p1 p2 [k3 ...]]`` on one line, or a 3x3 camera matrix."""

from __future__ import annotations

import re

from farpoint.camera.camera import Camera
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.matrix import Intrinsics, intrinsics_from_matrix
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.pinhole import Pinhole

TITLE = "bare numbers"
FIRST_IS_DEFAULT = False

NUMBERS = re.compile(r"(?i)(?:[-+.\d][-+.\de]*|[-+]?nan|[-+]?inf)(?:[\s,;]+|$)")
COUNTS = (4, 8, 9, 12, 16, 18)


def matches(file: CalibrationFile) -> bool:
    """Whether the file contains only numbers."""
    return bool(file.lines) and all(NUMBERS.sub("", line) == "" for line in file.lines)


def names(file: CalibrationFile) -> list[str]:
    """The name of the file, for its only camera."""
    return [file.path.stem]


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera, without an image size, because these files give none."""
    lines = [line.replace(",", " ").replace(";", " ").split() for line in file.lines]
    fields = Fields({"numbers": lines}, file.path)
    counts = [len(line) for line in lines]
    if counts not in ([3, 3, 3], *([count] for count in COUNTS)):
        raise fields.error(
            "numbers",
            "expected one line fx fy cx cy [k1 k2 p1 p2 [k3 ...]] or a 3x3 camera matrix, "
            f"got {len(counts)} lines, the first of {counts[0]}",
        )
    if counts == [3, 3, 3] or _is_matrix(fields):
        intrinsics, distortion = intrinsics_from_matrix(fields, "numbers"), []
    else:
        fx, fy, cx, cy, *distortion = fields.numbers("numbers")
        intrinsics = Intrinsics(fx=fx, fy=fy, cx=cx, cy=cy)
    with blame(fields, "numbers"):
        model = Pinhole(**intrinsics, distortion=tuple(distortion))
    return Camera(model=model, name=name)


def _is_matrix(fields: Fields) -> bool:
    """Whether nine numbers on one line are a matrix, which has zeros in second and fourth place.

    Read as focal lengths, principal point and coefficients, such numbers would give an fy of zero.
    """
    numbers = fields.numbers("numbers")
    return len(numbers) == 9 and numbers[1] == numbers[3] == 0.0
