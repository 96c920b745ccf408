"""The two pictures: the image with its points, and the translational flow."""

from __future__ import annotations

from typing import Any

import numpy as np

from farpoint.camera import Camera
from farpoint.errors import optional_import
from farpoint.odometry import OdometryResult
from farpoint.pose import TrackLabel
from farpoint.pose.flow import derotated_points
from farpoint.sinks.overlay.epipole import view_epipole
from farpoint.sinks.overlay.palette import WHITE, Colour, Palette
from farpoint.sinks.viewer import places

__all__ = ["Pictures"]

# Near points last: a few near points must not be hidden by many other points.
_NAMES = ((TrackLabel.OUTLIER, "outliers"), (TrackLabel.FAR, "far"), (TrackLabel.NEAR, "near"))
_JPEG_QUALITY = 80
_HALF_PX = 0.5  # origin: corner of the first pixel in Rerun, centre of the first pixel here
_MARKER = 0.012  # radius of the epipole's circle, in widths of the image
_NOTHING = np.empty((0, 2, 2), np.float32)


class Pictures:
    """Panes of the image with its tracks, and of the flow with the epipole.

    Colours and sizes are logged once. Each frame logs positions only.

    Parameters
    ----------
    recording : rerun.RecordingStream
        Recording that receives the drawings.
    palette : Palette
        Colours.
    """

    def __init__(self, recording: Any, palette: Palette) -> None:
        self._rr = rr = optional_import("rerun", extra="rerun", purpose="the display")
        self._recording = recording
        for place in (places.IMAGE, places.FLOW):
            for (_, name), colour in zip(
                _NAMES, (palette.outlier, palette.far, palette.near), strict=True
            ):
                self._style(f"{place}/{name}", colour, 0.7)
                dots = rr.Points2D.from_fields(colors=[colour], radii=rr.Radius.ui_points(2.0))
                recording.log(f"{place}/{name}", dots, static=True)
        self._style(f"{places.FLOW}/epipole/region", palette.heading, 1.0)
        self._style(f"{places.FLOW}/epipole/at", WHITE, 1.0)

    def draw_image(self, result: OdometryResult, image: np.ndarray | None) -> None:
        """Draw the newer image with a line for each track since the older image."""
        if image is None:
            self._recording.log(places.IMAGE, self._rr.Clear(recursive=False))
        else:
            cv2 = optional_import("cv2", extra="video", purpose="recording images")
            # JPEG has about 5 % of the raw size, and Rerun shows it without further libraries.
            jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1]
            picture = self._rr.EncodedImage(contents=jpeg.tobytes(), media_type="image/jpeg")
            self._recording.log(places.IMAGE, picture)
        self._draw_tracks(places.IMAGE, result, result.tracks.points1)

    def draw_flow(self, result: OdometryResult, camera: Camera, size: tuple[int, int]) -> None:
        """Draw the flow with the rotation removed, and the epipole with its 95 % region."""
        pose = result.pose
        heads = result.tracks.points1
        if pose is not None and pose.rotation_cam1_from_cam0 is not None:
            heads = derotated_points(camera, heads, pose.rotation_cam1_from_cam0)
        self._draw_tracks(places.FLOW, result, heads)
        view = None if pose is None else view_epipole(pose, camera, size)
        region, marker = [], []
        if view is not None:
            region = _pieces(view.ring_px + _HALF_PX)
            radius = _MARKER * size[0]
            for pixel, turn in ((view.ahead_px, 0.0), (view.behind_px, np.pi / 4.0)):
                marker += [] if pixel is None else _marker(pixel + _HALF_PX, radius, turn)
        self._draw_lines(f"{places.FLOW}/epipole/region", region)
        self._draw_lines(f"{places.FLOW}/epipole/at", marker)

    def _style(self, place: str, colour: Colour, radius: float) -> None:
        rr = self._rr
        lines = rr.LineStrips2D.from_fields(colors=[colour], radii=rr.Radius.ui_points(radius))
        self._recording.log(place, lines, static=True)

    def _draw_tracks(self, place: str, result: OdometryResult, heads: np.ndarray) -> None:
        ends, labels = _NOTHING, np.empty(0, np.uint8)
        if result.pose is not None:
            ends = np.stack([result.tracks.points0, heads], axis=1).astype(np.float32)
            labels = result.pose.labels
        seen = np.isfinite(ends).all(axis=(1, 2))
        for label, name in _NAMES:
            chosen = ends[seen & (labels == label)] + np.float32(_HALF_PX)
            lines = self._rr.LineStrips2D.from_fields(strips=chosen)
            dots = self._rr.Points2D.from_fields(positions=chosen[:, 1])
            self._recording.log(f"{place}/{name}", lines, dots)

    def _draw_lines(self, place: str, strips: list[np.ndarray]) -> None:
        self._recording.log(place, self._rr.LineStrips2D.from_fields(strips=strips))


def _marker(at: np.ndarray, radius: float, turn: float) -> list[np.ndarray]:
    """Lines of a circle with a cross around a pixel (2,), as in the paper.

    ``turn`` is the angle of the cross, rad; the cross at the antipode of the epipole is slanting.
    """
    angles = np.linspace(0.0, 2.0 * np.pi, 33)
    strips = [at + radius * np.column_stack([np.cos(angles), np.sin(angles)])]
    for angle in (turn, turn + np.pi / 2.0):
        arm = 1.6 * radius * np.array([np.cos(angle), np.sin(angle)])
        strips.append(np.stack([at - arm, at + arm]))
    return [strip.astype(np.float32) for strip in strips]


def _pieces(path_px: np.ndarray) -> list[np.ndarray]:
    """Pieces of a path (K, 2), which rows of NaN separate."""
    gaps = np.flatnonzero(~np.isfinite(path_px).all(axis=1))
    parts = [part[np.isfinite(part).all(axis=1)] for part in np.split(path_px, gaps)]
    return [part.astype(np.float32) for part in parts if len(part) > 1]
