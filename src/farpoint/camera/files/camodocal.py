"""CamOdoCal's camera files, which VINS-Mono, VINS-Fusion and KITTI-360's fisheyes use."""

from __future__ import annotations

from farpoint.camera.camera import Camera
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.lens import unsupported_lens
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.files.understood import refuse_unread
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.camera.model import CameraModel
from farpoint.camera.pinhole import Pinhole
from farpoint.camera.unified import Unified

TITLE = "CamOdoCal camera"
FIRST_IS_DEFAULT = False

MEI, FISHEYE, PINHOLE = "MEI", "KANNALA_BRANDT", "PINHOLE"


def matches(file: CalibrationFile) -> bool:
    """Whether the file has the fields ``model_type`` and ``projection_parameters``."""
    return all(key in file.fields for key in ("model_type", "projection_parameters"))


def names(file: CalibrationFile) -> list[str]:
    """The ``camera_name`` in the file, or else the name of the file."""
    fields = file.fields
    return [fields.text("camera_name") if "camera_name" in fields else file.path.stem]


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera of this file."""
    fields = file.fields
    size = fields.size("image_width", "image_height")
    kind = fields.text("model_type").upper()
    if kind not in (MEI, FISHEYE, PINHOLE):
        raise unsupported_lens(fields, "model_type", (MEI, FISHEYE, PINHOLE))
    with blame(fields, "projection_parameters", distortion="distortion_parameters"):
        camera = Camera(model=_lens(fields, kind), size=size, name=name)
    refuse_unread(fields)
    return camera


def _lens(fields: Fields, kind: str) -> CameraModel:
    projection = fields.group("projection_parameters")
    if kind == FISHEYE:
        # CamOdoCal's k2 to k5 are the coefficients k1 to k4 of KannalaBrandt.
        keys = ("mu", "mv", "u0", "v0", "k2", "k3", "k4", "k5")
        fx, fy, cx, cy, k1, k2, k3, k4 = (projection.number(key) for key in keys)
        return KannalaBrandt(fx=fx, fy=fy, cx=cx, cy=cy, k1=k1, k2=k2, k3=k3, k4=k4)
    coefficients = fields.group("distortion_parameters")
    distortion = tuple(coefficients.number(key) for key in ("k1", "k2", "p1", "p2"))
    keys = ("gamma1", "gamma2", "u0", "v0") if kind == MEI else ("fx", "fy", "cx", "cy")
    fx, fy, cx, cy = (projection.number(key) for key in keys)
    if kind == PINHOLE:
        return Pinhole(fx=fx, fy=fy, cx=cx, cy=cy, distortion=distortion)
    xi = fields.group("mirror_parameters").number("xi")
    return Unified(fx=fx, fy=fy, cx=cx, cy=cy, xi=xi, distortion=distortion)
