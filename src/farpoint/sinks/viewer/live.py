"""The display of a live session: it never holds the session up, and shows its delays."""

from __future__ import annotations

import os
import time
from typing import Any

import numpy as np

from farpoint.camera import Camera
from farpoint.errors import optional_import
from farpoint.odometry import OdometryResult
from farpoint.sinks.background import BackgroundSink
from farpoint.sinks.overlay.palette import PALETTES, PaletteName
from farpoint.sinks.viewer import places
from farpoint.sinks.viewer.layout import TIMELINE
from farpoint.sinks.viewer.options import ViewerOptions
from farpoint.sinks.viewer.viewer import Viewer, open_recording

__all__ = ["LiveViewer"]


class LiveViewer:
    """A sink that leaves frames out rather than wait, and counts them.

    Parameters
    ----------
    options : ViewerOptions
        Where the display goes.
    name : str
        Of the source, for the title.
    camera : Camera
        Camera of the frames.
    palette : {"red-green", "orange-blue"}
        Colours.

    Attributes
    ----------
    left_out : int
        Frames that were not drawn, because the drawing was behind.
    """

    def __init__(
        self,
        options: ViewerOptions,
        name: str,
        camera: Camera,
        palette: PaletteName = "red-green",
    ) -> None:
        self._rr = _load_quietly()
        self._recording = open_recording(options, name, endless=True)
        self._sink = BackgroundSink(Viewer(self._recording, camera, PALETTES[palette], live=True))
        self._link = ""
        self.left_out = 0
        curves = self._rr.SeriesLines(
            names=["latency, ms", "frames left out"], colors=[(240, 170, 60), (214, 48, 49)]
        )
        self._recording.log(places.DELAYS, curves, static=True)
        colours = PALETTES[palette]
        lanes = self._rr.StateConfiguration(
            values=["receiving", "silent", "lost"],
            labels=["receiving", "silent", "lost"],
            colors=[colours.good, colours.partial, colours.bad],
        )
        self._recording.log(places.LINK, lanes, static=True)

    def write(self, result: OdometryResult, image: np.ndarray | None) -> None:
        """Draw one frame, if there is room for it."""
        self.left_out += not self._sink.offer(result, image)

    def tell(self, latency_s: float, dropped: int) -> None:
        """Show how old the newest result is, and how many frames were left out before it."""
        self._recording.set_time(TIMELINE, timestamp=time.time())
        self._recording.log(places.DELAYS, self._rr.Scalars([1e3 * latency_s, float(dropped)]))

    def tell_link(self, link: str) -> None:
        """Show whether the source delivers, in a word or two, where that has changed."""
        if link != self._link:
            self._recording.set_time(TIMELINE, timestamp=time.time())
            self._recording.log(places.LINK, self._rr.StateChange(state=link))
            self._link = link

    def close(self) -> None:
        """Write what is still on its way and let go of file and window."""
        self._sink.close()


def _load_quietly() -> Any:
    """Rerun without its warning that the recording has no footer, which is our own choice.

    It reads what it may say when it is loaded, from the environment.
    """
    if "RUST_LOG" in os.environ:  # the user's word comes first
        return optional_import("rerun", extra="rerun", purpose="the display")
    os.environ["RUST_LOG"] = "warn,re_log_encoding=error"
    try:
        return optional_import("rerun", extra="rerun", purpose="the display")
    finally:
        del os.environ["RUST_LOG"]
