"""The display of a live session, which shows latencies and does not block the session."""

from __future__ import annotations

import subprocess
import time
from functools import partial
from typing import Any

import numpy as np

from farpoint.camera import Camera
from farpoint.errors import optional_import
from farpoint.odometry import OdometryResult
from farpoint.sinks.background import BackgroundSink
from farpoint.sinks.overlay.palette import PALETTES, PaletteName
from farpoint.sinks.process import SinkProcess, start_process
from farpoint.sinks.viewer import places
from farpoint.sinks.viewer.layout import TIMELINE
from farpoint.sinks.viewer.options import ViewerOptions
from farpoint.sinks.viewer.place import Place, claim
from farpoint.sinks.viewer.viewer import QUIET, Viewer, open_recording

__all__ = ["LiveViewer", "start_live_viewer"]


class LiveViewer:
    """A sink that leaves frames out instead of waiting, and counts the frames left out.

    Parameters
    ----------
    options : ViewerOptions
        Window and file of the display.
    name : str
        Name of the source, for the title.
    camera : Camera
        Camera of the frames.
    palette : {"red-green", "orange-blue"}
        Colours of the display.
    process : Popen, optional
        Process that draws, from an earlier call of `start_live_viewer`.

    Attributes
    ----------
    left_out : int
        Number of frames that were not drawn because drawing was too slow.
    """

    def __init__(
        self,
        options: ViewerOptions,
        name: str,
        camera: Camera,
        palette: PaletteName = "red-green",
        process: subprocess.Popen[bytes] | None = None,
    ) -> None:
        place = claim(options)
        make = partial(_Drawing, place, name, camera, palette)
        self._process = SinkProcess(make, place.name, process or start_live_viewer())
        self._sink = BackgroundSink(self._process)
        self._link = ""
        self.left_out = 0

    def write(self, result: OdometryResult, image: np.ndarray | None) -> None:
        """Draw one frame, or leave it out if the queue is full."""
        self.left_out += not self._sink.offer(result, image)

    def set_status(self, latency_s: float, dropped: int) -> None:
        """Show the latency of the newest result and the number of dropped frames."""
        self._note("set_status", latency_s, dropped)

    def set_link(self, link: str) -> None:
        """Show the state of the source if the state has changed."""
        if link != self._link:
            self._note("set_link", link)
            self._link = link

    def close(self) -> None:
        """Write the queued results, and close file and window."""
        self._sink.close()

    def _note(self, method: str, *arguments: object) -> None:
        self._sink.note(partial(self._process.call, method, time.time(), *arguments))


def start_live_viewer() -> subprocess.Popen[bytes]:
    """Start the process that draws, so that it is ready for the first frame."""
    # A low priority, because a slow display leaves frames out and never blocks the session.
    return start_process(__name__, "rerun", niceness=10, RUST_LOG=QUIET)


class _Drawing(Viewer):
    """The viewer that draws for a `LiveViewer`, in the process that draws."""

    def __init__(self, place: Place, name: str, camera: Camera, palette: PaletteName) -> None:
        self._rr = optional_import("rerun", extra="rerun", purpose="the display")
        self._recording = open_recording(place, name, endless=True)
        colours = PALETTES[palette]
        super().__init__(self._recording, camera, colours, live=True, rrd=place.rrd)
        curves = self._rr.SeriesLines(
            names=["latency, ms", "frames left out"], colors=[(240, 170, 60), (214, 48, 49)]
        )
        self._recording.log(places.DELAYS, curves, static=True)
        lanes = self._rr.StateConfiguration(
            values=["receiving", "silent", "lost"],
            labels=["receiving", "silent", "lost"],
            colors=[colours.good, colours.partial, colours.bad],
        )
        self._recording.log(places.LINK, lanes, static=True)

    def set_status(self, moment_s: float, latency_s: float, dropped: int) -> None:
        self._log(moment_s, places.DELAYS, self._rr.Scalars([1e3 * latency_s, float(dropped)]))

    def set_link(self, moment_s: float, link: str) -> None:
        self._log(moment_s, places.LINK, self._rr.StateChange(state=link))

    def _log(self, moment_s: float, place: str, what: Any) -> None:
        self._recording.reset_time()  # the value belongs to no frame
        self._recording.set_time(TIMELINE, timestamp=moment_s)
        self._recording.log(place, what)
