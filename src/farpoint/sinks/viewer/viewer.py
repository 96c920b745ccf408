"""The sink that draws the working display into a Rerun recording."""

from __future__ import annotations

from typing import Any

import numpy as np

from farpoint.camera import Camera
from farpoint.errors import optional_import
from farpoint.odometry import OdometryResult
from farpoint.sinks.background import BackgroundSink
from farpoint.sinks.overlay.palette import PALETTES, RED_GREEN, Palette, PaletteName
from farpoint.sinks.sink import open_output
from farpoint.sinks.viewer.curves import Curves
from farpoint.sinks.viewer.layout import TIMELINE, layout
from farpoint.sinks.viewer.options import ViewerOptions
from farpoint.sinks.viewer.pictures import Pictures
from farpoint.sinks.viewer.strip import Strip
from farpoint.sinks.viewer.window import open_window
from farpoint.sinks.viewer.world import World

__all__ = ["Viewer", "open_viewer"]

_YEAR_2001_S = 1e9  # time stamps beyond are dates, before it they count from a start


class Viewer:
    """Draws every result: pictures, path, curves and words, each at its own time.

    Parameters
    ----------
    recording : rerun.RecordingStream
        Drawn into, and closed.
    camera : Camera
        Camera of the frames; without a size, the first image gives it.
    palette : Palette
        Colours.
    live : bool
        The layout shows delays as well.
    """

    def __init__(
        self,
        recording: Any,
        camera: Camera,
        palette: Palette = RED_GREEN,
        *,
        live: bool = False,
    ) -> None:
        self._recording = recording
        self._camera = camera
        self._live = live
        self._laid_out = False
        self._pictures = Pictures(recording, palette)
        self._world = World(recording, palette)
        self._curves = Curves(recording)
        self._strip = Strip(recording, palette)

    def write(self, result: OdometryResult, image: np.ndarray | None) -> None:
        """Draw one frame."""
        if image is not None and self._camera.size is None:
            self._camera = self._camera.with_size(image.shape[1], image.shape[0])
        size = self._camera.size
        if size is None:
            return  # nothing was seen yet
        if not self._laid_out:
            self._recording.send_blueprint(layout(size, live=self._live))
            self._laid_out = True
        set_moment(self._recording, result)
        self._pictures.draw_image(result, image)
        self._pictures.draw_flow(result, self._camera, size)
        self._world.draw(result, self._camera)
        self._curves.draw(result)
        self._strip.draw(result)

    def close(self) -> None:
        """Write what is still on its way and let go of file and window."""
        self._recording.flush()
        self._recording.disconnect()


def set_moment(recording: Any, result: OdometryResult) -> None:
    """From here on, what this thread draws belongs to the frame of a result."""
    recording.set_time("frame", sequence=result.frame1)
    if result.timestamp >= _YEAR_2001_S:
        recording.set_time(TIMELINE, timestamp=result.timestamp)
    else:
        recording.set_time(TIMELINE, duration=result.timestamp)


def open_viewer(
    options: ViewerOptions, name: str, camera: Camera, palette: PaletteName = "red-green"
) -> BackgroundSink:
    """The display as a sink that draws in a thread of its own.

    Parameters
    ----------
    options : ViewerOptions
        Where it goes.
    name : str
        Of the source, for the title.
    camera : Camera
        Camera of the frames.
    palette : {"red-green", "orange-blue"}
        Colours.

    Raises
    ------
    InputError
        If the file cannot be written or the window cannot be opened.
    MissingExtraError
        If rerun-sdk is not installed.
    """
    viewer = Viewer(open_recording(options, name), camera, PALETTES[palette])
    return BackgroundSink(viewer)


def open_recording(options: ViewerOptions, name: str, *, endless: bool = False) -> Any:
    """A Rerun recording that goes where the options say."""
    rr = optional_import("rerun", extra="rerun", purpose="the display")
    sinks: list[Any] = []
    if options.rrd is not None:
        open_output(options.rrd).close()  # Rerun would complain in a thread of its own
        # The footer lists every piece of the file, for faster scrubbing; until the end the list is
        # held in memory, which a session without an end cannot afford.
        sinks.append(rr.FileSink(options.rrd, write_footer=not endless))
    if options.show:
        sinks.append(rr.GrpcSink(open_window()))
    recording = rr.RecordingStream("farpoint")
    recording.set_sinks(*sinks)
    recording.set_log_time_enabled(False)  # a timeline that nobody looks at
    recording.send_recording_name(name)
    return recording
