"""Calibration files: one module for each format, recognised by content."""

from farpoint.camera.files.load import load_camera
from farpoint.camera.files.own import write_camera

__all__ = ["load_camera", "write_camera"]
