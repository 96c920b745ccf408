"""OCamCalib's ``calib_results.txt``, in which the toolbox exports Scaramuzza's polynomial."""

from __future__ import annotations

import re

from farpoint.camera.camera import Camera
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.scaramuzza import Scaramuzza

TITLE = "OCamCalib results"
FIRST_IS_DEFAULT = False

COMMENT = re.compile(r"(?i)#.*(ocam_model|cam2world|polynomial coefficients)")
# One line for each, in this order.
DIRECT, INVERSE, CENTRE, AFFINE, SIZE = (
    "polynomial coefficients (direct)",
    "polynomial coefficients (inverse)",
    "center",
    "affine parameters",
    "image size",
)


def matches(file: CalibrationFile) -> bool:
    """Whether the file has comments of the toolbox, or lines that begin with a count of numbers."""
    if COMMENT.search(file.text) is not None:
        return True
    rows = [line.split() for line in file.lines]
    return (
        [len(row) for row in rows[2:]] == [2, 3, 2]
        and len(rows) == 5
        and all(row[0] == str(len(row) - 1) for row in rows[:2])
    )


def names(file: CalibrationFile) -> list[str]:
    """The name of the file, for its only camera."""
    return [file.path.stem]


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera. The toolbox counts rows and columns from 0, as farpoint does."""
    keys = (DIRECT, INVERSE, CENTRE, AFFINE, SIZE)
    fields = Fields(dict(zip(keys, file.lines, strict=False)), file.path)
    count, *coefficients = fields.numbers(DIRECT)
    if count != len(coefficients):
        raise fields.error(DIRECT, f"expected {count:g} coefficients, got {len(coefficients)}")
    row, column = fields.numbers(CENTRE, (2,))
    c, d, e = fields.numbers(AFFINE, (3,))
    height, width = fields.numbers(SIZE, (2,))
    size = Fields({SIZE: [width, height]}, file.path).size_pair(SIZE)
    with blame(fields, DIRECT, cx=CENTRE, cy=CENTRE, c=AFFINE, d=AFFINE, e=AFFINE):
        model = Scaramuzza(coefficients=tuple(coefficients), cx=column, cy=row, c=c, d=d, e=e)
    return Camera(model=model, size=size, name=name)
