"""Cameras of the rendered streets."""

from __future__ import annotations

from farpoint.camera import Camera, Equirectangular, KannalaBrandt

__all__ = ["CAMERAS", "FISHEYE", "PANORAMA", "PINHOLE"]

PINHOLE = Camera.pinhole(640, 480, 500.0, 500.0, 319.5, 239.5)
FISHEYE = Camera(
    model=KannalaBrandt(fx=190.978, fy=190.973, cx=254.932, cy=256.897, k1=3.48e-3, k2=7.15e-4),
    size=(512, 512),
)
PANORAMA = Camera(model=Equirectangular(width=1024, height=512), size=(1024, 512))

# Cameras by their names in the tables.
CAMERAS = {"pinhole, 65 deg": PINHOLE, "fisheye, 195 deg": FISHEYE, "360": PANORAMA}
