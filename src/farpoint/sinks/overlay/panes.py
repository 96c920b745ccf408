"""The two panes: the image with its points, and the flow that translation leaves."""

from __future__ import annotations

import numpy as np

from farpoint.camera import Camera
from farpoint.geometry.angles import heading_angles_deg
from farpoint.odometry import OdometryResult
from farpoint.pose import RelativePose, TrackLabel
from farpoint.pose.flow import derotated_points
from farpoint.sinks.overlay.canvas import (
    BACKGROUND,
    FAR_RED,
    HEADING_YELLOW,
    NEAR_GREEN,
    OUTLIER_GREY,
    QUIET_GREY,
    WHITE,
    Canvas,
    draw_text,
    text_width,
)
from farpoint.sinks.overlay.epipole import EpipoleView, view_epipole

__all__ = ["draw_flow_pane", "draw_points_pane"]

_ARROW_REACH = 0.95  # how far out the arrow's tip stands, as a part of the way to the border


def draw_points_pane(canvas: Canvas, result: OdometryResult, line_px: float) -> None:
    """Tracks over the newer image: far red rings, near green discs, outliers grey crosses."""
    _draw_tracks(canvas, result, result.tracks.points0, result.tracks.points1)
    _caption(canvas, f"frame {result.frame1}   {result.timestamp:.3f} s", line_px, top=True)


def draw_flow_pane(
    canvas: Canvas,
    result: OdometryResult,
    camera: Camera,
    size: tuple[int, int],
    line_px: float,
) -> None:
    """The flow with the rotation taken out, in the pixels of the older image; the epipole."""
    pose = result.pose
    _caption(canvas, "translational flow (rotation removed)", line_px, top=True)
    if pose is None or pose.rotation_cam1_from_cam0 is None:
        return
    heads = derotated_points(camera, result.tracks.points1, pose.rotation_cam1_from_cam0)
    _draw_tracks(canvas, result, result.tracks.points0, heads)
    view = view_epipole(pose, camera, size)
    if view is None:
        _caption(canvas, "direction not observable", line_px, top=False)
        return
    if view.pixel is not None:
        _draw_marker(canvas, view.pixel)
    else:
        _draw_border_arrow(canvas, view, camera)
    canvas.path(view.ring_px, HEADING_YELLOW)  # on top: a sure heading's ellipse is a small one
    _caption(canvas, _epipole_caption(view, pose), line_px, top=False)


def _draw_tracks(
    canvas: Canvas, result: OdometryResult, tails: np.ndarray, heads: np.ndarray
) -> None:
    if result.pose is None:
        return
    flow = np.stack([tails, heads], axis=1)
    # Near points last: they are fewest where it matters and must not be hidden.
    for label, colour in (
        (TrackLabel.OUTLIER, OUTLIER_GREY),
        (TrackLabel.FAR, FAR_RED),
        (TrackLabel.NEAR, NEAR_GREEN),
    ):
        chosen = result.pose.labels == label
        canvas.segments(flow[chosen], colour)
        if label is TrackLabel.OUTLIER:
            canvas.crosses(heads[chosen], colour, 2.0)
        elif label is TrackLabel.FAR:
            canvas.rings(heads[chosen], colour, 3.0)
        else:
            canvas.dots(heads[chosen], colour, 2.6)


def _draw_marker(canvas: Canvas, pixel: np.ndarray) -> None:
    """The circle with a cross; dark underneath, so that it stands out of any flow."""
    centre = pixel[None]
    for colour, width in ((BACKGROUND, 3), (WHITE, 1)):
        heavy = Canvas(pixels=canvas.pixels, scale=canvas.scale, stroke=width * canvas.stroke)
        heavy.rings(centre, colour, 9.0 / width)
        heavy.crosses(centre, colour, 14.0 / width)


def _draw_border_arrow(canvas: Canvas, view: EpipoleView, camera: Camera) -> None:
    """An arrow at the pane's border, towards where the camera travels."""
    far_corner = np.array(canvas.pixels.shape[1::-1]) / canvas.scale - 0.5
    axis_px = camera.project(np.array([[0.0, 0.0, 1.0]]))[0]
    middle = axis_px if np.isfinite(axis_px).all() else far_corner / 2.0
    towards = view.heading[:2] / np.linalg.norm(view.heading[:2])
    room = np.where(towards > 0.0, far_corner - middle, middle) / np.maximum(np.abs(towards), 1e-9)
    tip = middle + _ARROW_REACH * room.min() * towards
    back = 40.0 * canvas.stroke / canvas.scale * towards
    side = 12.0 * canvas.stroke / canvas.scale * np.array([-towards[1], towards[0]])
    for end in (tip - 0.4 * back + side, tip - 0.4 * back - side, tip - back):
        canvas.segments(np.stack([end, tip])[None], WHITE, 3 * canvas.stroke)


def _epipole_caption(view: EpipoleView, pose: RelativePose) -> str:
    assert pose.heading_covariance is not None
    (azimuth, elevation), _ = heading_angles_deg(view.heading, pose.heading_covariance)
    if view.backward:
        return "epipole: where the camera comes from (it moves backward); 95 % ellipse"
    if view.pixel is not None:
        return "epipole with 95 % ellipse"
    across = f"{abs(azimuth):.0f} deg {'right' if azimuth > 0 else 'left'}"
    upright = f"{abs(elevation):.0f} deg {'up' if elevation > 0 else 'down'}"
    return f"epipole outside the image: heading {across}, {upright}"


def _caption(canvas: Canvas, text: str, line_px: float, *, top: bool) -> None:
    """A line of small text on a darkened ground along the top or the bottom of the pane."""
    capital = 0.46 * line_px
    height, width = canvas.pixels.shape[:2]
    bar = round(line_px)
    band = slice(0, bar) if top else slice(height - bar, height)
    right = min(width, text_width(text, capital) + round(line_px))
    canvas.pixels[band, :right] //= 3
    baseline = band.start + 0.5 * (bar + capital)
    draw_text(canvas.pixels, text, 0.4 * line_px, baseline, capital, WHITE if top else QUIET_GREY)
