"""Cameras: projection and unprojection, and readers of calibration files."""

from farpoint.camera.approximate import (
    CameraGuess,
    EquivalentFocalLength,
    HorizontalField,
    camera_for,
)
from farpoint.camera.arctangent import Arctangent
from farpoint.camera.camera import Camera
from farpoint.camera.describe import describe
from farpoint.camera.division import Division
from farpoint.camera.double_sphere import DoubleSphere
from farpoint.camera.equirectangular import Equirectangular
from farpoint.camera.extended_unified import ExtendedUnified
from farpoint.camera.field_of_view import FieldOfView, field_of_view, valid_region
from farpoint.camera.files import load_camera, write_camera
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.camera.model import CameraModel
from farpoint.camera.path import project_path
from farpoint.camera.pinhole import Pinhole
from farpoint.camera.radial_curve import RadialCurve, draw_radial_curve, radial_curve
from farpoint.camera.scaramuzza import Scaramuzza
from farpoint.camera.uncertainty import CameraUncertainty, covariance_factor
from farpoint.camera.unified import Unified

__all__ = [
    "Arctangent",
    "Camera",
    "CameraGuess",
    "CameraModel",
    "CameraUncertainty",
    "Division",
    "DoubleSphere",
    "Equirectangular",
    "EquivalentFocalLength",
    "ExtendedUnified",
    "FieldOfView",
    "HorizontalField",
    "KannalaBrandt",
    "Pinhole",
    "RadialCurve",
    "Scaramuzza",
    "Unified",
    "camera_for",
    "covariance_factor",
    "describe",
    "draw_radial_curve",
    "field_of_view",
    "load_camera",
    "project_path",
    "radial_curve",
    "valid_region",
    "write_camera",
]
