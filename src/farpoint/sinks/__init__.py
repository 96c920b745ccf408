"""Where results go: files and pictures, each written as the run goes."""

from farpoint.sinks.motions import Motions, read_motions
from farpoint.sinks.output_folder import OutputFolder, OutputOptions
from farpoint.sinks.overlay import draw_overlay
from farpoint.sinks.report import write_report
from farpoint.sinks.run_record import RunDescription, RunState, read_run

__all__ = [
    "Motions",
    "OutputFolder",
    "OutputOptions",
    "RunDescription",
    "RunState",
    "draw_overlay",
    "read_motions",
    "read_run",
    "write_report",
]
