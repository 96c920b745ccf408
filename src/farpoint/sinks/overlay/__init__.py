"""``overlay.mp4``: the working of the method, drawn over the frames."""

from farpoint.sinks.overlay.picture import draw_overlay
from farpoint.sinks.overlay.video import OverlayVideo

__all__ = ["OverlayVideo", "draw_overlay"]
