"""Calibration files: one module for each format, recognised by content."""

from farpoint.camera.files.load import load_camera

__all__ = ["load_camera"]
