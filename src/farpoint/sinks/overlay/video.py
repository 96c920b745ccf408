"""The sink ``overlay.mp4``: an H.264 video for browsers and phones, playable during the run."""

from __future__ import annotations

import contextlib
import subprocess
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from farpoint.camera import Camera
from farpoint.errors import optional_import, require
from farpoint.odometry import OdometryResult
from farpoint.sinks.background import BackgroundSink
from farpoint.sinks.files import check_writable, part_of
from farpoint.sinks.overlay.fragments import FragmentFile
from farpoint.sinks.overlay.layout import Layout
from farpoint.sinks.overlay.palette import PaletteName
from farpoint.sinks.overlay.picture import draw_overlay
from farpoint.sinks.process import SinkProcess, start_process

__all__ = [
    "KEYFRAME_INTERVAL",
    "OverlayVideo",
    "open_video",
    "require_libraries",
    "start_video_process",
]

KEYFRAME_INTERVAL = 15
"""Frames from one key frame to the next. The small pictures of reports are key frames."""

_TICK = Fraction(1, 90_000)  # s: exact for 24, 25, 30 and 60 frames a second
_NOMINAL_RATE = 30  # frames a second; the encoder requires a rate, but time stamps are exact

# One fragment per frame: a file that was never closed can be played and lacks at most one frame.
# `OverlayVideo.close` rewrites the file with one index at the beginning, so that phones show the
# duration and can seek.
_CONTAINER = {"movflags": "frag_every_frame+empty_moov+default_base_moof", "flush_packets": "1"}
# No look-ahead and no B-frames: every picture is in the file as soon as possible. The next slower
# preset would save 20 % of the bytes and take twice as long. One thread: more threads would use the
# cores of the estimation.
_ENCODER = {
    "preset": "ultrafast",
    "tune": "zerolatency",
    "crf": "25",
    "x264-params": "no-deblock=0",  # deblocking on, so that no blocks show in the sky
}
_LIBRARIES = {"av": "writing overlay.mp4", "cv2": "drawing overlay.mp4"}


class OverlayVideo:
    """Draws every frame and encodes the picture with the time stamp of the frame.

    Parameters
    ----------
    path : Path
        The file; an existing file is replaced.
    camera : Camera
        Camera of the frames. The picture's size depends on the camera's image size, or on the first
        image if the camera has no image size.
    palette : {"red-green", "orange-blue"}
        Colours, as `draw_overlay` takes them.
    mask : ndarray of bool, shape (height, width), optional
        True where the frames are used.

    Raises
    ------
    InputError
        If the file cannot be written.
    MissingExtraError
        If PyAV or OpenCV is not installed.
    """

    def __init__(
        self,
        path: Path,
        camera: Camera,
        palette: PaletteName = "red-green",
        mask: np.ndarray | None = None,
    ) -> None:
        self._av, self._cv2 = (
            optional_import(name, extra="video", purpose=purpose)
            for name, purpose in _LIBRARIES.items()
        )
        self._path, self._camera = path, camera
        self._palette: PaletteName = palette
        self._mask = mask
        self._stream: Any = None
        self._start_s = 0.0
        self._last_tick = -1
        check_writable(path)  # the file is created with the first frame, too late for an error
        self._file = FragmentFile(path)
        self._container: Any = self._av.open(self._file, "w", format="mp4", options=_CONTAINER)

    def write(self, result: OdometryResult, image: np.ndarray | None) -> None:
        """Draw and encode one frame; a frame without an image is drawn with its values only."""
        if self._camera.size is None:
            if image is None:
                return  # the size of the picture is not known yet
            self._camera = self._camera.with_size(image.shape[1], image.shape[0])
        stream = self._stream or self._open_stream(result.timestamp)
        picture = draw_overlay(image, result, self._camera, self._palette, self._mask)
        planes = self._cv2.cvtColor(
            picture, self._cv2.COLOR_RGB2YUV_I420
        )  # three times as fast as PyAV's conversion
        frame = self._av.VideoFrame.from_ndarray(planes, format="yuv420p")
        # Presentation times must increase, also if time stamps repeat or decrease.
        tick = max(round((result.timestamp - self._start_s) / _TICK), self._last_tick + 1)
        frame.pts, frame.time_base = tick, _TICK
        self._last_tick = tick
        self._container.mux(stream.encode(frame))
        self._file.raise_problem()

    def close(self) -> None:
        """Write the pictures that are still in the encoder, and close the file."""
        container, self._container = self._container, None
        if container is None:
            return
        try:
            if self._stream is not None:
                container.mux(self._stream.encode(None))
        finally:
            try:
                container.close()
            finally:
                self._file.close()
        if self._file.is_at_its_path():
            with contextlib.suppress(OSError, self._av.FFmpegError):  # the fragments then stay
                self._pack()
        self._file.raise_problem()

    def _pack(self) -> None:
        """Rewrite the file with one index at the beginning; pictures do not change."""
        part = part_of(self._path)
        try:
            with self._av.open(str(self._path)) as video:
                options = {"movflags": "faststart"}
                with self._av.open(str(part), "w", format="mp4", options=options) as packed:
                    source = video.streams.video[0]
                    target = packed.add_stream_from_template(source)
                    for packet in video.demux(source):
                        if packet.dts is not None:
                            packet.stream = target
                            packed.mux(packet)
            if self._file.is_at_its_path():
                part.replace(self._path)
        finally:
            part.unlink(missing_ok=True)

    def _open_stream(self, start_s: float) -> Any:
        assert self._camera.size is not None
        layout = Layout.of_image(*self._camera.size)
        stream = self._container.add_stream("libx264", rate=_NOMINAL_RATE, options=_ENCODER)
        stream.width, stream.height, stream.pix_fmt = layout.width, layout.height, "yuv420p"
        stream.time_base = stream.codec_context.time_base = _TICK
        stream.codec_context.gop_size = KEYFRAME_INTERVAL
        stream.codec_context.thread_count = 1
        # Without this entry, players would assume BT.709 for tall pictures.
        stream.codec_context.colorspace = self._av.video.reformatter.Colorspace.ITU601
        stream.codec_context.color_range = self._av.video.reformatter.ColorRange.MPEG
        self._stream, self._start_s = stream, start_s
        return stream


def open_video(
    path: Path,
    camera: Camera,
    palette: PaletteName = "red-green",
    process: subprocess.Popen[bytes] | None = None,
    mask: np.ndarray | None = None,
) -> BackgroundSink:
    """An `OverlayVideo` in a separate process, with the same errors.

    An error is raised by this function if the error can be found without waiting for the process.
    The process may have been started by `start_video_process`.
    """
    require_libraries()
    check_writable(path)
    make = partial(OverlayVideo, path.absolute(), camera, palette, mask)
    return BackgroundSink(SinkProcess(make, path, process or start_video_process()))


def require_libraries() -> None:
    """Raise a MissingExtraError if a library for drawing or encoding is not installed."""
    for name, purpose in _LIBRARIES.items():
        require(name, extra="video", purpose=purpose)


def start_video_process() -> subprocess.Popen[bytes]:
    """Start the process that draws the video, so that it is ready for the first frame."""
    return start_process(__name__, *_LIBRARIES)
