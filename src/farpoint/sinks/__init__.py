"""Sinks of results: files and pictures, written during the run."""

from farpoint.sinks.bag import BagSink
from farpoint.sinks.lock import FolderLock
from farpoint.sinks.metric import MetricSink
from farpoint.sinks.motions import Motions, read_motions
from farpoint.sinks.output_folder import OutputFolder, OutputOptions
from farpoint.sinks.overlay import draw_overlay, start_video_process
from farpoint.sinks.process import wait_until_loaded
from farpoint.sinks.report import write_report
from farpoint.sinks.run_record import RunDescription, RunState, read_run
from farpoint.sinks.viewer import LiveViewer, Viewer, ViewerOptions, open_viewer, start_live_viewer

__all__ = [
    "BagSink",
    "FolderLock",
    "LiveViewer",
    "MetricSink",
    "Motions",
    "OutputFolder",
    "OutputOptions",
    "RunDescription",
    "RunState",
    "Viewer",
    "ViewerOptions",
    "draw_overlay",
    "open_viewer",
    "read_motions",
    "read_run",
    "start_live_viewer",
    "start_video_process",
    "wait_until_loaded",
    "write_report",
]
