"""``overlay.mp4``: tracks, flow and epipole of each frame, drawn and encoded as a video."""

from farpoint.sinks.overlay.palette import PALETTES, PaletteName
from farpoint.sinks.overlay.picture import draw_overlay
from farpoint.sinks.overlay.video import (
    OverlayVideo,
    open_video,
    require_libraries,
    start_video_process,
)

__all__ = [
    "PALETTES",
    "OverlayVideo",
    "PaletteName",
    "draw_overlay",
    "open_video",
    "require_libraries",
    "start_video_process",
]
