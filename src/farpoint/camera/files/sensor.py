"""EuRoC's ``sensor.yaml``: one camera with its intrinsics, in the ASL dataset format."""

from __future__ import annotations

from collections.abc import Mapping

from farpoint.camera.camera import Camera
from farpoint.camera.files import opencv
from farpoint.camera.files.lens import lens_of_sensor
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.files.understood import refuse_unread

TITLE = "EuRoC sensor.yaml"
FIRST_IS_DEFAULT = False


def matches(file: CalibrationFile) -> bool:
    """Whether the fields of a sensor are at the top level."""
    fields = file.fields
    is_list = "intrinsics" in fields and not isinstance(fields.values["intrinsics"], Mapping)
    if not is_list and "sensor_type" not in fields and opencv.matches(file):
        return False  # an OpenCV file, whose ``camera_model`` may name a sensor
    return fields.first("sensor_type", "camera_model") is not None or (
        "intrinsics" in fields and fields.first("distortion_model", "resolution") is not None
    )


def names(file: CalibrationFile) -> list[str]:
    """The name of the file, for its only camera."""
    return [file.path.stem]


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera of this file."""
    fields = file.fields
    if "sensor_type" in fields and fields.text("sensor_type") != "camera":
        raise fields.error("sensor_type", f"expected camera, got {fields.text('sensor_type')}")
    model = lens_of_sensor(fields, coefficients="distortion_coefficients")
    camera = Camera(model=model, size=fields.size_pair("resolution"), name=name)
    refuse_unread(fields)
    return camera
