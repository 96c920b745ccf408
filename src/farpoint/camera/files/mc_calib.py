"""MC-Calib's ``calibrated_cameras_data.yml``: groups ``camera_0``, ``camera_1`` and so on."""

from __future__ import annotations

import re
from collections.abc import Mapping

from farpoint.camera.camera import Camera
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.matrix import intrinsics_from_matrix
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.files.understood import refuse_others
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.camera.model import CameraModel
from farpoint.camera.pinhole import Pinhole

TITLE = "MC-Calib cameras"
FIRST_IS_DEFAULT = False

KEY = re.compile(r"camera_\d+")
OWN = ("distortion_vector", "distortion_type")
KNOWN = (*("camera_matrix", *OWN, "camera_group", "img_width", "img_height", "camera_pose_matrix"),)
PERSPECTIVE, FISHEYE = 0, 1


def matches(file: CalibrationFile) -> bool:
    """Whether a group ``camera_0`` has a ``distortion_vector`` or ``distortion_type``."""
    return bool(names(file))


def names(file: CalibrationFile) -> list[str]:
    """The groups of the cameras."""
    return [
        key
        for key, group in file.fields.values.items()
        if KEY.fullmatch(key) and isinstance(group, Mapping) and any(own in group for own in OWN)
    ]


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera of this name."""
    camera = file.fields.group(name)
    refuse_others(camera, KNOWN)
    return Camera(model=_lens(camera), size=camera.size("img_width", "img_height"), name=name)


def _lens(camera: Fields) -> CameraModel:
    kind = camera.number("distortion_type")
    if kind not in (PERSPECTIVE, FISHEYE):
        raise camera.error(
            "distortion_type",
            f"the lens model {kind:g} is not supported; expected 0 (perspective) or 1 (fisheye)",
        )
    intrinsics = intrinsics_from_matrix(camera, "camera_matrix")
    with blame(camera, "camera_matrix", distortion="distortion_vector"):
        if kind == PERSPECTIVE:
            distortion = tuple(camera.numbers("distortion_vector", (4, 5, 8)))
            return Pinhole(**intrinsics, distortion=distortion)
        k1, k2, k3, k4 = camera.numbers("distortion_vector", (4,))
        return KannalaBrandt(**intrinsics, k1=k1, k2=k2, k3=k3, k4=k4)
