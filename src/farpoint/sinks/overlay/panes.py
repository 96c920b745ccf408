"""The two panes: the image with its points, and the translational flow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from farpoint.camera import Camera, Pinhole, project_path
from farpoint.geometry.angles import heading_angles_deg
from farpoint.odometry import OdometryResult
from farpoint.pose import RelativePose, TrackLabel
from farpoint.pose.flow import derotated_points
from farpoint.sinks.overlay.canvas import Canvas, draw_text, text_width
from farpoint.sinks.overlay.epipole import EpipoleView, meridians, view_epipole
from farpoint.sinks.overlay.palette import BACKGROUND, GUIDE_GREY, QUIET_GREY, WHITE

__all__ = ["draw_flow_pane", "draw_points_pane"]

_ARROW_REACH = 0.95  # distances from the optical axis: arrow's tip over border of the image


def draw_points_pane(
    canvas: Canvas, result: OdometryResult, camera: Camera, line_px: float
) -> None:
    """Draw tracks over the newer image: far points as rings, near as discs, outliers as crosses."""
    tracks = result.tracks
    if result.pose is not None and len(tracks):
        _draw_matches(canvas, result.pose, camera, tracks.points0, tracks.points1)
    _caption(canvas, f"frame {result.frame1}   {result.timestamp:.3f} s", line_px, top=True)


def draw_flow_pane(
    canvas: Canvas,
    result: OdometryResult,
    camera: Camera,
    size: tuple[int, int],
    line_px: float,
) -> None:
    """Draw the epipole, and the flow without the rotation, in pixels of the older image."""
    pose = result.pose
    if pose is None or pose.rotation_cam1_from_cam0 is None:
        _caption(canvas, "translational flow (rotation removed)", line_px, top=True)
        return
    view = view_epipole(pose, camera, size)
    if view is not None and _is_curved(camera):
        canvas.path(project_path(camera, meridians(view.heading)), GUIDE_GREY)
    if len(result.tracks):
        heads = derotated_points(camera, result.tracks.points1, pose.rotation_cam1_from_cam0)
        _draw_matches(canvas, pose, camera, result.tracks.points0, heads)
    if view is not None:
        _draw_epipole(canvas, view, camera)
    _caption(canvas, "translational flow (rotation removed)", line_px, top=True)
    _caption(canvas, _epipole_caption(view, pose), line_px, top=False)


# Near points last: a few near points must not be hidden by many other points.
_DRAWN_IN_ORDER = (TrackLabel.OUTLIER, TrackLabel.FAR, TrackLabel.NEAR)


def _draw_matches(
    canvas: Canvas, pose: RelativePose, camera: Camera, tails: np.ndarray, heads: np.ndarray
) -> None:
    """Draw a line (a great circle if the lens bends lines) and a marker for each match."""
    for label in _DRAWN_IN_ORDER:
        chosen = pose.labels == label
        colour = _colour(canvas, label)
        if _is_curved(camera):
            ends = [camera.unproject(points[chosen]) for points in (tails, heads)]
            arcs = np.stack([*ends, np.full_like(ends[0], np.nan)], axis=1)
            canvas.path(project_path(camera, arcs.reshape(-1, 3)), colour)
        else:
            canvas.segments(np.stack([tails, heads], axis=1)[chosen], colour)
        _draw_heads(canvas, heads[chosen], label)


def _is_curved(camera: Camera) -> bool:
    """Whether lines are drawn as projected great circles: for every lens model but `Pinhole`."""
    return not isinstance(camera.model, Pinhole)


def _colour(canvas: Canvas, label: TrackLabel) -> tuple[int, int, int]:
    palette = canvas.palette
    return {
        TrackLabel.OUTLIER: palette.outlier,
        TrackLabel.FAR: palette.far,
        TrackLabel.NEAR: palette.near,
    }[label]


def _draw_heads(canvas: Canvas, heads: np.ndarray, label: TrackLabel) -> None:
    """Draw markers whose shape depends on the label, so that labels differ not only in colour."""
    colour = _colour(canvas, label)
    if label is TrackLabel.OUTLIER:
        canvas.crosses(heads, colour, 3.0)
    elif label is TrackLabel.FAR:
        canvas.holes(heads, colour, 3.4)
    else:
        canvas.dots(heads, colour, 2.6)


def _draw_epipole(canvas: Canvas, view: EpipoleView, camera: Camera) -> None:
    """Draw epipole and antipode, and on top the 95 % region, because the region may be small."""
    if view.ahead_px is None and view.behind_px is None:
        _draw_border_arrow(canvas, view, camera)
    if view.behind_px is not None:
        _draw_marker(canvas, view.behind_px, slanting=True)
    if view.ahead_px is not None:
        _draw_marker(canvas, view.ahead_px, slanting=False)
    canvas.path(view.ring_px, canvas.palette.heading)


def _draw_marker(canvas: Canvas, pixel: np.ndarray, *, slanting: bool) -> None:
    """Draw a circle with a cross. The dark outline makes the marker visible on any flow."""
    centre = pixel[None]
    for colour, width in ((BACKGROUND, 3), (WHITE, 1)):
        heavy = replace(canvas, stroke=width * canvas.stroke)
        heavy.rings(centre, colour, 9.0 / width)
        heavy.crosses(centre, colour, 14.0 / width, slanting=slanting)


def _draw_border_arrow(canvas: Canvas, view: EpipoleView, camera: Camera) -> None:
    """Draw an arrow at the pane's border that points in the direction of travel."""
    far_corner = np.array(canvas.pixels.shape[1::-1]) / canvas.scale - 0.5
    axis_px = camera.project(np.array([[0.0, 0.0, 1.0]]))[0]
    middle = axis_px if np.isfinite(axis_px).all() else far_corner / 2.0
    towards = view.heading[:2] / np.linalg.norm(view.heading[:2])
    reach = np.where(towards > 0.0, far_corner - middle, middle) / np.maximum(np.abs(towards), 1e-9)
    tip = middle + _ARROW_REACH * reach.min() * towards
    back = 40.0 * canvas.stroke / canvas.scale * towards
    side = 12.0 * canvas.stroke / canvas.scale * np.array([-towards[1], towards[0]])
    for end in (tip - 0.4 * back + side, tip - 0.4 * back - side, tip - back):
        canvas.segments(np.stack([end, tip])[None], WHITE, 3 * canvas.stroke)


def _epipole_caption(view: EpipoleView | None, pose: RelativePose) -> str:
    if view is None:
        return "direction not observable"
    assert pose.heading_covariance is not None
    if view.ahead_px is not None and view.behind_px is not None:
        return "epipole (+) with 95 % ellipse; behind: (x)"
    if view.ahead_px is not None:
        return "epipole with 95 % ellipse"
    if view.behind_px is not None:
        return "moving backward: (x) is where the camera comes from; 95 % ellipse"
    (azimuth, elevation), _ = heading_angles_deg(view.heading, pose.heading_covariance)
    across = f"{abs(azimuth):.0f} deg {'right' if azimuth > 0 else 'left'}"
    upright = f"{abs(elevation):.0f} deg {'up' if elevation > 0 else 'down'}"
    return f"epipole outside the image: heading {across}, {upright}"


def _caption(canvas: Canvas, text: str, line_px: float, *, top: bool) -> None:
    """Draw a line of small text on a dark background along the top or the bottom of the pane."""
    capital = 0.46 * line_px
    height, width = canvas.pixels.shape[:2]
    bar = round(line_px)
    band = slice(0, bar) if top else slice(height - bar, height)
    right = min(width, text_width(text, capital) + round(line_px))
    canvas.pixels[band, :right] //= 3
    baseline = band.start + 0.5 * (bar + capital)
    draw_text(canvas.pixels, text, 0.4 * line_px, baseline, capital, WHITE if top else QUIET_GREY)
