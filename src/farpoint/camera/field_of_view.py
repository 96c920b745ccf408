"""Field of view of a camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint.camera.camera import Camera
from farpoint.errors import InputError
from farpoint.geometry.sphere import angle_between

__all__ = ["FieldOfView", "field_of_view", "valid_region"]

SAMPLES = 513


@dataclass(frozen=True, kw_only=True)
class FieldOfView:
    """Angles of the field of view, rad, over the pixels that have a ray. An angle may exceed pi.

    Attributes
    ----------
    horizontal_rad, vertical_rad : float
        Angles along the row and along the column through the principal point, from border to
        border.
    diagonal_rad : float
        Angle from corner to corner, along the wider of the two diagonals.
    complete : bool
        Whether every pixel on the row, the column and the two diagonals has a ray.
    """

    horizontal_rad: float
    vertical_rad: float
    diagonal_rad: float
    complete: bool


def field_of_view(camera: Camera) -> FieldOfView:
    """Field of view of a camera whose image size is known.

    Each angle is the sum of the small rotations of the ray from step to step along a line through
    the image. Fields of view above 180 degrees are therefore measured correctly.

    Raises
    ------
    InputError
        If the camera has no image size.
    """
    if camera.size is None:
        raise InputError("the calibration gives no image size", field="camera")
    right, bottom = camera.size[0] - 0.5, camera.size[1] - 0.5
    (cx, cy) = camera.project(np.array([[0.0, 0.0, 1.0]]))[0]
    lines = [
        ((-0.5, cy), (right, cy)),
        ((cx, -0.5), (cx, bottom)),
        ((-0.5, -0.5), (right, bottom)),
        ((-0.5, bottom), (right, -0.5)),
    ]
    rays = [camera.unproject(np.linspace(start, end, SAMPLES)) for start, end in lines]
    steps = [angle_between(along[:-1], along[1:]) for along in rays]
    horizontal, vertical, falling, rising = (float(np.nansum(angles)) for angles in steps)
    return FieldOfView(
        horizontal_rad=horizontal,
        vertical_rad=vertical,
        diagonal_rad=max(falling, rising),
        complete=bool(np.all(np.isfinite(rays))),
    )


def valid_region(camera: Camera) -> np.ndarray:
    """Mask (height, width), bool, of the pixels that have a ray, such as the image circle of a
    fisheye.

    Raises
    ------
    InputError
        If the camera has no image size.
    """
    if camera.size is None:
        raise InputError("the calibration gives no image size", field="camera")
    width, height = camera.size
    pixels = np.moveaxis(np.indices((height, width))[::-1], 0, -1).reshape(-1, 2)
    return np.isfinite(camera.unproject(pixels)[:, 0]).reshape(height, width)
