"""Layout of the window."""

from __future__ import annotations

from typing import Any

from farpoint.errors import optional_import
from farpoint.sinks.viewer import places

__all__ = ["TIMELINE", "layout"]

TIMELINE = "time"

_STACKED_FROM_ASPECT = 1.9  # wide images stand one above the other
_POINTS_S = 10.0  # time for which a point is shown, s


def layout(size: tuple[int, int], *, live: bool) -> Any:
    """Rerun's blueprint for images of this size (width, height), with delays if ``live``."""
    rrb = optional_import("rerun.blueprint", extra="rerun", purpose="the display")
    stacked = size[0] >= _STACKED_FROM_ASPECT * size[1]
    pictures = (rrb.Vertical if stacked else rrb.Horizontal)(
        _picture(rrb, places.IMAGE, "image: far, near, outliers", size),
        _picture(rrb, places.FLOW, "translational flow, epipole and its 95 % region", size),
    )
    curves = [
        rrb.TimeSeriesView(origin=places.ROTATION, name="rotation rate, deg/s, with 1 sigma"),
        rrb.TimeSeriesView(origin=places.HEADING, name="heading, deg, with 1 sigma"),
    ]
    if live:
        curves.append(rrb.TimeSeriesView(origin=places.DELAYS, name="latency, ms; frames left out"))
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(pictures, _world(rrb), column_shares=[3, 2]),
            rrb.Horizontal(*curves),
            rrb.Horizontal(
                rrb.TextDocumentView(origin=places.VALUES, name="values"),
                rrb.StateTimelineView(origin=places.STATUS, name="status"),
                column_shares=[3, 2],
            ),
            row_shares=[6, 2.5, 1.8],
        ),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def _picture(rrb: Any, origin: str, name: str, size: tuple[int, int]) -> Any:
    bounds = rrb.VisualBounds2D(x_range=[0, size[0]], y_range=[0, size[1]])
    return rrb.Spatial2DView(origin=origin, name=name, visual_bounds=bounds)


def _world(rrb: Any) -> Any:
    """Pane of the world: the path up to the time cursor, recent points, and the current camera."""
    rr = optional_import("rerun", extra="rerun", purpose="the display")
    now = rrb.TimeRangeBoundary.cursor_relative()
    recent = rrb.TimeRangeBoundary.cursor_relative(seconds=-_POINTS_S)

    def since(start: Any) -> Any:
        return rrb.VisibleTimeRanges(rr.VisibleTimeRange(TIMELINE, start=start, end=now))

    return rrb.Spatial3DView(
        origin=places.WORLD,
        name="path, with the points of the last 10 s",
        eye_controls=rrb.EyeControls3D(tracking_entity=places.CAMERA),
        overrides={
            places.PATH: since(rrb.TimeRangeBoundary.infinite()),
            places.POINTS: since(recent),
        },
    )
