"""Cameras: from pixels to rays and back, and the calibration files they come from."""

from farpoint.camera.camera import Camera
from farpoint.camera.describe import describe
from farpoint.camera.double_sphere import DoubleSphere
from farpoint.camera.extended_unified import ExtendedUnified
from farpoint.camera.field_of_view import FieldOfView, field_of_view
from farpoint.camera.files import load_camera
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.camera.model import CameraModel
from farpoint.camera.pinhole import Pinhole

__all__ = [
    "Camera",
    "CameraModel",
    "DoubleSphere",
    "ExtendedUnified",
    "FieldOfView",
    "KannalaBrandt",
    "Pinhole",
    "describe",
    "field_of_view",
    "load_camera",
]
