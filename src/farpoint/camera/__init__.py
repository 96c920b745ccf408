"""Cameras: from pixels to rays and back, and the calibration files they come from."""

from farpoint.camera.camera import Camera
from farpoint.camera.model import CameraModel
from farpoint.camera.pinhole import Pinhole

__all__ = ["Camera", "CameraModel", "Pinhole"]
