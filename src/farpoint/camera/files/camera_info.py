"""The message ``CameraInfo`` of ROS: a lens, a binning and a region of interest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from farpoint.camera.camera import Camera
from farpoint.camera.files.fields import Fields
from farpoint.camera.files.opencv import read_fields
from farpoint.camera.files.read_out import ReadOut
from farpoint.errors import InputError

__all__ = ["CameraInfo", "camera_of_info"]


@dataclass(frozen=True, kw_only=True)
class CameraInfo:
    """The fields of ``sensor_msgs/CameraInfo``.

    Attributes
    ----------
    width, height : int
        Size of the full image, px.
    distortion_model : str
        ``plumb_bob``, ``rational_polynomial``, ``equidistant``, or a synonym of these names.
    d : sequence of float
        Coefficients of the distortion, in OpenCV's order.
    k : sequence of float
        Camera matrix of raw images, 3x3 by rows, px of the full image.
    p : sequence of float
        Projection matrix of rectified images, 3x4 by rows.
    read_out : ReadOut
        Binning and region of interest of the images.
    """

    width: int
    height: int
    distortion_model: str
    d: Sequence[float]
    k: Sequence[float]
    p: Sequence[float]
    read_out: ReadOut = field(default_factory=ReadOut)


def camera_of_info(info: CameraInfo, *, rectified: bool, file: Path, topic: str) -> Camera:
    """The camera of the raw images or of the rectified images.

    Parameters
    ----------
    info : CameraInfo
        The message.
    rectified : bool
        Whether the images are rectified. The camera of rectified images has the matrix P and no
        distortion.
    file, topic : Path, str
        File and topic that error messages name.

    Raises
    ------
    InputError
        If the camera is not calibrated, or the lens is unknown.
    """
    key, matrix = ("P", _left_of(info.p)) if rectified else ("K", list(info.k))
    if len(matrix) != 9 or matrix[0] == 0.0:
        raise InputError(
            f"its {key} is not calibrated: give a calibration by --camera", file=file, field=topic
        )
    values: dict[str, Any] = {"k": matrix}
    if info.width and info.height:
        values |= {"width": info.width, "height": info.height}
    # A model without coefficients distorts nothing, whatever it is called.
    if not rectified and any(info.d):
        values |= {"d": list(info.d), "distortion_model": info.distortion_model or "plumb_bob"}
    camera = read_fields(Fields(values, file, f"{topic} "), topic)
    camera = replace(camera, name=topic, source=f"CameraInfo, {file}")
    try:
        return info.read_out.of(camera)
    except InputError as error:
        raise InputError(error.problem, file=file, field=f"{topic} {error.field}") from error


def _left_of(p: Sequence[float]) -> list[float]:
    """The left 3x3 part of a 3x4 matrix; empty for a matrix of another size."""
    return [*p[0:3], *p[4:7], *p[8:11]] if len(p) == 12 else []
