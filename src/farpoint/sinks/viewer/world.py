"""The path in space: camera, previous positions and points."""

from __future__ import annotations

from typing import Any

import numpy as np

from farpoint.camera import Camera
from farpoint.errors import optional_import
from farpoint.geometry import so3
from farpoint.odometry import OdometryResult
from farpoint.path.prediction import inverse_depths
from farpoint.pose import TrackLabel
from farpoint.sinks.overlay.palette import WHITE, Colour, Palette
from farpoint.sinks.viewer import places

__all__ = ["World", "position_region", "sparse_points"]

_FARTHEST = 60.0
"""Largest distance of drawn points, divided by the length of the translation of the pair."""

_CHI2_3_AT_95 = 7.8147  # quantile of chi-square with 3 degrees of freedom

# The camera as a pyramid, in the unit of the path: tip, then the corners of the image.
_PYRAMID = np.array([[0, 0, 0], [-1, -0.6, 1.5], [1, -0.6, 1.5], [1, 0.6, 1.5], [-1, 0.6, 1.5]])
_EDGES = ((0, 1, 2, 0), (0, 3, 4, 0), (1, 4), (2, 3))


class World:
    """Pane of the path, which grows with each frame, so that the cursor can move through time.

    Parameters
    ----------
    recording : rerun.RecordingStream
        Recording that receives the drawings.
    palette : Palette
        Colours.
    """

    def __init__(self, recording: Any, palette: Palette) -> None:
        self._rr = optional_import("rerun", extra="rerun", purpose="the display")
        self._recording = recording
        self._last: np.ndarray | None = None
        recording.log(places.WORLD, self._rr.ViewCoordinates.RDF, static=True)
        self._style(places.PATH, WHITE, 1.5)
        self._style(places.CONE, palette.heading, 1.0)
        region = self._rr.Ellipsoids3D.from_fields(
            colors=[palette.heading],
            line_radii=self._rr.Radius.ui_points(0.7),
            fill_mode=self._rr.components.FillMode.MajorWireframe,
        )
        recording.log(places.POSITION, region, static=True)
        radius = self._rr.Radius.ui_points(1.5)
        dots = self._rr.Points3D.from_fields(colors=[palette.near], radii=radius)
        recording.log(places.POINTS, dots, static=True)
        self._style(f"{places.CAMERA}/body", WHITE, 1.0)
        body = self._rr.LineStrips3D.from_fields(strips=[_PYRAMID[list(edge)] for edge in _EDGES])
        recording.log(f"{places.CAMERA}/body", body, static=True)

    def draw(self, result: OdometryResult, camera: Camera) -> None:
        """Draw the camera, the last step, the region of the heading, and near points."""
        pose = result.world_from_cam
        position = pose[:3, 3]
        turn = self._rr.Quaternion(xyzw=so3.quat_xyzw_from_matrix(pose[:3, :3]))
        moved = self._rr.Transform3D(translation=position, quaternion=turn)
        self._recording.log(places.CAMERA, moved)
        if self._last is not None and np.any(position != self._last):
            self._draw_lines(places.PATH, [np.stack([self._last, position])])
        self._draw_lines(places.CONE, _heading_cone(result))
        self._draw_position(result)
        points = self._rr.Points3D.from_fields(positions=sparse_points(result, camera))
        self._recording.log(places.POINTS, points)
        self._last = position

    def _draw_position(self, result: OdometryResult) -> None:
        rr, covariance = self._rr, result.world_covariance
        centres, sizes, turns = [], [], []
        if covariance is not None and np.any(covariance[3:6, 3:6]):
            half_axes, R_world_from_axes = position_region(covariance[3:6, 3:6])
            centres, sizes = [result.world_from_cam[:3, 3]], [half_axes]
            turns = [rr.Quaternion(xyzw=so3.quat_xyzw_from_matrix(R_world_from_axes))]
        region = rr.Ellipsoids3D.from_fields(centers=centres, half_sizes=sizes, quaternions=turns)
        self._recording.log(places.POSITION, region)

    def _style(self, place: str, colour: Colour, radius: float) -> None:
        rr = self._rr
        lines = rr.LineStrips3D.from_fields(colors=[colour], radii=rr.Radius.ui_points(radius))
        self._recording.log(place, lines, static=True)

    def _draw_lines(self, place: str, strips: list[np.ndarray]) -> None:
        self._recording.log(place, self._rr.LineStrips3D.from_fields(strips=strips))


def position_region(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The 95 % ellipsoid of a position: half axes (3,), and their directions (3, 3).

    Parameters
    ----------
    covariance : ndarray, shape (3, 3)
        Covariance of the position.

    Returns
    -------
    half_axes : ndarray, shape (3,)
        Lengths in the unit of the position.
    axes : ndarray, shape (3, 3)
        A rotation; its columns are the directions of the axes.
    """
    variances, axes = np.linalg.eigh(covariance)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    return np.sqrt(_CHI2_3_AT_95 * np.maximum(variances, 0.0)), axes


def _heading_cone(result: OdometryResult) -> list[np.ndarray]:
    """The 95 % cone of the heading, with its tip at the previous position: strips (K, 3)."""
    pose, scale = result.pose, result.scale
    region = None if pose is None else pose.heading_region(0.95)
    if pose is None or region is None or scale is None:
        return []
    assert pose.rotation_cam1_from_cam0 is not None
    assert pose.heading_cam0 is not None
    R_world_from_cam0 = result.world_from_cam[:3, :3] @ pose.rotation_cam1_from_cam0
    start = result.world_from_cam[:3, 3] - scale * R_world_from_cam0 @ pose.heading_cam0
    rim = start + scale * region @ R_world_from_cam0.T
    return [rim, *(np.stack([start, end]) for end in rim[:: len(rim) // 4])]


def sparse_points(result: OdometryResult, camera: Camera) -> np.ndarray:
    """Positions (P, 3) in the world of the near points of a pair; empty without a translation."""
    pose, tracks, scale = result.pose, result.tracks, result.scale
    if pose is None or pose.direction_cam1_from_cam0 is None or scale is None:
        return np.empty((0, 3))
    assert pose.rotation_cam1_from_cam0 is not None
    near = tracks.select(pose.labels == TrackLabel.NEAR)
    rays0, rays1 = camera.unproject(near.points0), camera.unproject(near.points1)
    inverse = inverse_depths(
        rays0, rays1, pose.rotation_cam1_from_cam0, pose.direction_cam1_from_cam0
    )
    good = inverse > 1.0 / _FARTHEST
    points = rays1[good] * (scale / inverse[good])[:, None]
    return points @ result.world_from_cam[:3, :3].T + result.world_from_cam[:3, 3]
