"""Files of KITTI: ``calib.txt`` of the odometry benchmark and ``calib_cam_to_cam.txt`` of the raw
data.
"""

from __future__ import annotations

import re

from farpoint.camera.camera import Camera
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.matrix import intrinsics_from_matrix
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.pinhole import Pinhole

TITLE = "KITTI calibration"
FIRST_IS_DEFAULT = True

# P0 ... P3 and P_rect_00 ... project into rectified images; K_00 ... with D_00 ... into raw ones.
RECTIFIED = re.compile(r"P\d|P_rect_\d\d")
RAW = re.compile(r"K_\d\d")
LINE = re.compile(rf"(?m)^({RECTIFIED.pattern}|{RAW.pattern}):[ \t]*[^\s!\[{{]")


def matches(file: CalibrationFile) -> bool:
    """Whether a line begins like ``P0: 7.07e+02 ...``."""
    return LINE.search(file.text) is not None


def names(file: CalibrationFile) -> list[str]:
    """Names of the rectified cameras, then names of the raw cameras."""
    keys = _fields(file).values
    return [key for kind in (RECTIFIED, RAW) for key in keys if kind.fullmatch(key)]


def read(file: CalibrationFile, name: str) -> Camera:
    """One camera. Only ``calib_cam_to_cam.txt`` gives an image size."""
    fields = _fields(file)
    number = name[-2:]
    if RAW.fullmatch(name):
        distortion, size_key = fields.numbers(f"D_{number}"), f"S_{number}"
        intrinsics = intrinsics_from_matrix(fields, name)
    else:
        distortion, size_key = [], f"S_rect_{number}"
        intrinsics = intrinsics_from_matrix(fields, name, columns=4)
    with blame(fields, name, distortion=f"D_{number}"):
        model = Pinhole(**intrinsics, distortion=tuple(distortion))
    return Camera(model=model, size=fields.size_pair(size_key), name=name)


def _fields(file: CalibrationFile) -> Fields:
    pairs = (line.partition(":") for line in file.lines)
    return Fields({key.strip(): value.strip() for key, _, value in pairs}, file.path)
