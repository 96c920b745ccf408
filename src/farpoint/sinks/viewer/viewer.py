"""The sink that draws the display into a Rerun recording."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from farpoint.camera import Camera
from farpoint.errors import InputError, optional_import
from farpoint.odometry import OdometryResult
from farpoint.sinks.background import BackgroundSink
from farpoint.sinks.overlay.palette import PALETTES, RED_GREEN, Palette, PaletteName
from farpoint.sinks.process import SinkProcess, start_process
from farpoint.sinks.viewer.curves import Curves
from farpoint.sinks.viewer.layout import TIMELINE, layout
from farpoint.sinks.viewer.options import ViewerOptions
from farpoint.sinks.viewer.pictures import Pictures
from farpoint.sinks.viewer.place import Place, claim
from farpoint.sinks.viewer.strip import Strip
from farpoint.sinks.viewer.world import World

__all__ = ["Viewer", "open_viewer"]

QUIET = "warn,re_log_encoding=off"
"""Log level of Rerun, without messages about files: the sink itself reports file errors."""

_FLUSH_EVERY_S = 1.0
_TIMEOUT_S = 5.0
_YEAR_2001_S = 1e9  # larger time stamps are dates; smaller ones count from the start of a recording


class Viewer:
    """Sink that draws every result (pictures, path, curves and text) at the time of its frame.

    Parameters
    ----------
    recording : rerun.RecordingStream
        Recording that receives the drawings; the viewer closes it.
    camera : Camera
        Camera of the frames. If the camera has no image size, the size of the first image is used.
    palette : Palette
        Colours.
    live : bool
        Whether the layout also shows delays.
    rrd : Path, optional
        File of the recording, if any.

    Raises
    ------
    InputError
        Raised by `write` and `close` if the file can no longer be written.
    """

    def __init__(
        self,
        recording: Any,
        camera: Camera,
        palette: Palette = RED_GREEN,
        *,
        live: bool = False,
        rrd: Path | None = None,
    ) -> None:
        self._recording = recording
        self._rrd, self._is_stalled = rrd, False
        self._flushed_s = time.monotonic()
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
            return  # the image size is unknown before the first image
        if not self._laid_out:
            self._recording.send_blueprint(layout(size, live=self._live))
            self._laid_out = True
        set_moment(self._recording, result)
        self._pictures.draw_image(result, image)
        self._pictures.draw_flow(result, self._camera, size)
        self._world.draw(result, self._camera)
        self._curves.draw(result)
        self._strip.draw(result)
        if self._rrd is not None and time.monotonic() - self._flushed_s > _FLUSH_EVERY_S:
            self._flush(self._rrd)

    def close(self) -> None:
        """Write the queued data, and close file and window."""
        if self._is_stalled:  # Rerun would wait for ever
            return
        if self._rrd is None:
            self._recording.flush()
        else:
            self._flush(self._rrd)
        self._recording.disconnect()

    def _flush(self, rrd: Path) -> None:
        """Check that the file grows, because Rerun writes in its own thread and raises no error."""
        try:
            self._recording.flush(timeout_sec=_TIMEOUT_S)
        except RuntimeError as error:
            self._is_stalled = True
            problem = "cannot be written to its end, as on a full disk"
            raise InputError(problem, file=rrd) from error
        self._flushed_s = time.monotonic()


def set_moment(recording: Any, result: OdometryResult) -> None:
    """Set the time and the frame number of the next drawings."""
    recording.set_time("frame", sequence=result.frame1)
    if result.timestamp >= _YEAR_2001_S:
        recording.set_time(TIMELINE, timestamp=result.timestamp)
    else:
        recording.set_time(TIMELINE, duration=result.timestamp)


def open_viewer(
    options: ViewerOptions, name: str, camera: Camera, palette: PaletteName = "red-green"
) -> BackgroundSink:
    """The display as a sink that draws in a separate process.

    Parameters
    ----------
    options : ViewerOptions
        Options of the display.
    name : str
        Name of the source, for the title.
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
    place = claim(options)
    process = start_process(__name__, "rerun", niceness=10, RUST_LOG=QUIET)
    make = partial(_make, place, name, camera, palette)
    return BackgroundSink(SinkProcess(make, place.name, process))


def _make(place: Place, name: str, camera: Camera, palette: PaletteName) -> Viewer:
    return Viewer(open_recording(place, name), camera, PALETTES[palette], rrd=place.rrd)


def open_recording(place: Place, name: str, *, endless: bool = False) -> Any:
    """A Rerun recording that is sent to the window and written to the file of ``place``."""
    rr = optional_import("rerun", extra="rerun", purpose="the display")
    sinks: list[Any] = []
    if place.rrd is not None:
        # The footer lists every piece of the file, for faster scrubbing. The list grows in memory
        # until the end, so a session without an end writes no footer.
        sinks.append(rr.FileSink(place.rrd, write_footer=not endless))
    if place.url is not None:
        sinks.append(rr.GrpcSink(place.url))
    recording = rr.RecordingStream("farpoint")
    recording.set_sinks(*sinks)
    recording.set_log_time_enabled(False)  # the timeline of log times is not used
    recording.send_recording_name(name)
    return recording
