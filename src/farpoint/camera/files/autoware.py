"""Calibration files of Autoware's camera-lidar tools: ``CameraMat`` and ``DistCoeff``."""

from __future__ import annotations

from farpoint.camera.camera import Camera
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.lens import unsupported_lens
from farpoint.camera.files.matrix import intrinsics_from_matrix
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.files.understood import LENS_WORDS, refuse_others
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.camera.model import CameraModel
from farpoint.camera.pinhole import Pinhole

TITLE = "Autoware calibration"
FIRST_IS_DEFAULT = False

MATRIX, DISTORTION, MODEL = "CameraMat", "DistCoeff", "DistModel"
# ROS's names of lenses, which Autoware uses unchanged.
PINHOLES, FISHEYE = ("plumb_bob", "rational_polynomial"), "equidistant"


def matches(file: CalibrationFile) -> bool:
    """Whether there is a matrix ``CameraMat``."""
    return MATRIX in file.fields


def names(file: CalibrationFile) -> list[str]:
    """The name of the file, for its only camera."""
    return [file.path.stem]


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera of this file."""
    fields = file.fields
    refuse_others(fields, (MATRIX, DISTORTION, MODEL), only=LENS_WORDS)
    return Camera(model=_lens(fields), size=fields.size_pair("ImageSize"), name=name)


def _lens(fields: Fields) -> CameraModel:
    kind = fields.text(MODEL).lower() if MODEL in fields else PINHOLES[0]
    if kind not in (*PINHOLES, FISHEYE):
        raise unsupported_lens(fields, MODEL, (*PINHOLES, FISHEYE))
    intrinsics = intrinsics_from_matrix(fields, MATRIX)
    with blame(fields, MATRIX, distortion=DISTORTION):
        if kind == FISHEYE:
            k1, k2, k3, k4 = fields.numbers(DISTORTION, (4,))
            return KannalaBrandt(**intrinsics, k1=k1, k2=k2, k3=k3, k4=k4)
        return Pinhole(**intrinsics, distortion=tuple(fields.numbers(DISTORTION)))
