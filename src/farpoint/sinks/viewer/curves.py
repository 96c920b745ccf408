"""Curves over time: angular velocity and heading, each with its 1-sigma band."""

from __future__ import annotations

from typing import Any

import numpy as np

from farpoint.errors import optional_import
from farpoint.geometry.angles import heading_angles_deg, rotation_vector_deg
from farpoint.odometry import OdometryResult
from farpoint.sinks.overlay.palette import Colour
from farpoint.sinks.viewer import places

__all__ = ["Curves"]

_ROTATION: dict[str, Colour] = {"x": (230, 90, 80), "y": (90, 200, 110), "z": (95, 150, 240)}
_HEADING: dict[str, Colour] = {"right": (240, 170, 60), "up": (150, 200, 240)}
_BAND_ALPHA = 110


class Curves:
    """Curves of values with 1-sigma bands. A curve is broken where a value is missing.

    Parameters
    ----------
    recording : rerun.RecordingStream
        Recording that receives the drawings.
    """

    def __init__(self, recording: Any) -> None:
        self._rr = optional_import("rerun", extra="rerun", purpose="the display")
        self._recording = recording
        self._style(places.ROTATION, _ROTATION)
        self._style(places.HEADING, _HEADING)

    def draw(self, result: OdometryResult) -> None:
        """Add the angular velocity and the heading of one pair."""
        self._add(places.ROTATION, *_rotation_rate(result))
        self._add(places.HEADING, *_heading(result))

    def _style(self, place: str, curves: dict[str, Colour]) -> None:
        colours = [(*colour, 255) for colour in curves.values()]
        bands = [(*colour, _BAND_ALPHA) for colour in curves.values()]
        lines = self._rr.SeriesLines(
            names=[*curves, *(f"{name} {sign} sigma" for sign in "-+" for name in curves)],
            colors=[*colours, *bands, *bands],
            widths=[2.0] * len(curves) + [1.0] * 2 * len(curves),
        )
        self._recording.log(place, lines, static=True)

    def _add(self, place: str, values: np.ndarray, sigma: np.ndarray) -> None:
        curves = np.concatenate([values, values - sigma, values + sigma])
        self._recording.log(place, self._rr.Scalars(curves))


def _rotation_rate(result: OdometryResult) -> tuple[np.ndarray, np.ndarray]:
    """Rotation vector divided by time (3,), and 1-sigma (3,), deg/s; NaN if unknown."""
    pose, elapsed_s = result.pose, result.timestamp - result.timestamp0
    unknown = np.full(3, np.nan)
    if pose is None or pose.rotation_cam1_from_cam0 is None or elapsed_s <= 0.0:
        return unknown, unknown
    assert pose.rotation_covariance is not None
    vector, sigma = rotation_vector_deg(pose.rotation_cam1_from_cam0, pose.rotation_covariance)
    return vector / elapsed_s, sigma / elapsed_s


def _heading(result: OdometryResult) -> tuple[np.ndarray, np.ndarray]:
    """Angles of the heading to the right and up (2,), and 1-sigma (2,), deg; NaN if unknown."""
    pose, unknown = result.pose, np.full(2, np.nan)
    if pose is None or pose.heading_cam0 is None or pose.heading_covariance is None:
        return unknown, unknown
    return heading_angles_deg(pose.heading_cam0, pose.heading_covariance)
