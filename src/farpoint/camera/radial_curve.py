"""Radial curve of a lens (angle by image radius), as numbers and as a plot of characters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint.camera.camera import Camera
from farpoint.errors import InputError

__all__ = ["RadialCurve", "draw_radial_curve", "radial_curve"]

SAMPLES = 1001
COLUMNS, ROWS = 60, 13


@dataclass(frozen=True, kw_only=True, eq=False)
class RadialCurve:
    """Angles off the axis along a line through the image.

    Attributes
    ----------
    radius_px : ndarray, shape (N,)
        Distance from the pixel of the optical axis, increasing from 0.
    angle_rad : ndarray, shape (N,)
        Angle of the ray off the axis.
    """

    radius_px: np.ndarray
    angle_rad: np.ndarray


def radial_curve(camera: Camera) -> RadialCurve:
    """The curve from the axis to the border of the image, along the line with the largest angle.

    The line ends at a corner, or at the border in the row or column of the axis. For most images
    the end is a corner. For a 360-degree picture the end is the middle of the left or right side.
    The curve ends where pixels have no ray.

    Raises
    ------
    InputError
        If the camera has no image size.
    """
    if camera.size is None:
        raise InputError("the calibration gives no image size", field="camera")
    axis_px = camera.project(np.array([[0.0, 0.0, 1.0]]))[0]
    left, right, top, bottom = -0.5, camera.size[0] - 0.5, -0.5, camera.size[1] - 0.5
    border = np.array(
        [(u, v) for u in (left, axis_px[0], right) for v in (top, axis_px[1], bottom)]
    )
    lines = axis_px + np.linspace(0.0, 1.0, SAMPLES)[:, None, None] * (border - axis_px)
    cosine = camera.unproject(lines.reshape(-1, 2))[:, 2].reshape(SAMPLES, -1)
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))
    farthest = int(np.argmax(np.fmax.reduce(np.nan_to_num(angle, nan=-1.0), axis=0)))
    seen = np.isfinite(angle[:, farthest])
    radius = np.linalg.norm(lines[:, farthest] - axis_px, axis=1)
    return RadialCurve(radius_px=radius[seen], angle_rad=angle[seen, farthest])


def draw_radial_curve(camera: Camera) -> str:
    """The curve as a plot of characters, with the radius to the right and the angle upwards.

    Dots show the pinhole that has the same scale at the centre. No dots are drawn where the two
    curves coincide.
    """
    curve = radial_curve(camera)
    radius, angle = curve.radius_px, np.rad2deg(curve.angle_rad)
    if len(radius) < 3 or not (radius[-1] > 0.0 and angle.max() > 0.0):
        return "no radial curve: the lens model ends beside its axis"
    near = 1 + len(radius) // 50
    straight = np.rad2deg(np.arctan(radius * np.tan(curve.angle_rad[near]) / radius[near]))
    column = np.round(radius / radius[-1] * (COLUMNS - 1)).astype(int)
    canvas = np.full((ROWS, COLUMNS), " ")
    for values, mark in ((straight, "."), (angle, "*")):
        row = np.round(values / angle.max() * (ROWS - 1)).astype(int)
        inside = row < ROWS
        canvas[row[inside], column[inside]] = mark
    marks = {0: f"{0:.0f}", ROWS // 2: f"{angle.max() / 2:.0f}", ROWS - 1: f"{angle.max():.0f}"}
    lines = ["angle off the axis, deg (* this lens, . a pinhole like its centre)"]
    for row in reversed(range(ROWS)):
        lines.append(f"{marks.get(row, ''):>5} |{''.join(canvas[row]).rstrip()}")
    end = f"{radius[-1]:.0f} px"
    lines.append("      +" + "-" * COLUMNS)
    lines.append(f"       0{end:>{COLUMNS - 1}}")
    return "\n".join(lines)
