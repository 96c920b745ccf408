"""Kalibr's ``camchain.yaml``, also used by TUM-VI: a group of fields for each camera."""

from __future__ import annotations

from collections.abc import Mapping

from farpoint.camera.camera import Camera
from farpoint.camera.files.lens import lens_of_sensor
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.files.understood import refuse_unread

TITLE = "Kalibr camera chain"
FIRST_IS_DEFAULT = False


def matches(file: CalibrationFile) -> bool:
    """Whether some group at the top level describes a camera."""
    return bool(names(file))


def names(file: CalibrationFile) -> list[str]:
    """Names of the groups that describe cameras, such as ``cam0``."""
    return [
        key
        for key, group in file.fields.values.items()
        if isinstance(group, Mapping) and ("camera_model" in group or "distortion_coeffs" in group)
    ]


def read(file: CalibrationFile, name: str) -> Camera:
    """One camera of the chain."""
    fields = file.fields.group(name)
    model = lens_of_sensor(fields, coefficients="distortion_coeffs")
    camera = Camera(model=model, size=fields.size_pair("resolution"), name=name)
    refuse_unread(fields)
    return camera
