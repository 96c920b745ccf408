"""The display in the Rerun viewer, shown during a run or recorded in a file."""

from farpoint.sinks.viewer.live import LiveViewer, start_live_viewer
from farpoint.sinks.viewer.options import ViewerOptions
from farpoint.sinks.viewer.viewer import Viewer, open_viewer

__all__ = ["LiveViewer", "Viewer", "ViewerOptions", "open_viewer", "start_live_viewer"]
