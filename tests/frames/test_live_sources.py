"""Cameras and streams: time stamps of the wall clock, and secrets that stay secret."""

from __future__ import annotations

import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import cv2
import numpy as np
import pytest

from farpoint.errors import InputError
from farpoint.frames import open_frames
from farpoint.frames.network import in_wall_clock
from farpoint.frames.packets import Moment

WriteVideo = Callable[..., Path]


@contextmanager
def served(video: Path, *, length_told: bool) -> Iterator[str]:
    """The URL of a server that sends the file in one go."""

    class Sender(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            if length_told:
                self.send_header("Content-Length", str(video.stat().st_size))
            self.end_headers()
            self.wfile.write(video.read_bytes())

        def log_message(self, *_: object) -> None:
            """Keep stderr clean."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Sender)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        yield f"http://user:secret@127.0.0.1:{server.server_port}/front/{video.name}?token=secret"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def test_a_live_stream_has_the_wall_clock(write_video: WriteVideo):
    with served(write_video("a.ts"), length_told=False) as url:
        before = time.time()
        source = open_frames(url)
        frames = list(source)
    assert (source.count, source.timestamp_source) == (None, "wall clock")
    assert source.name.startswith("127.0.0.1")
    assert source.name.endswith("front-a.ts")
    assert "secret" not in source.name
    assert len(frames) == 31
    assert "reading stopped" in str(frames.pop().fault)  # the server hung up
    assert all(frame.image is not None for frame in frames)
    assert before < frames[0].timestamp < time.time()
    # The sender's clock, although all arrived at once.
    assert np.diff([frame.timestamp for frame in frames]) == pytest.approx(0.04, abs=1e-6)


def test_a_recording_behind_a_url_has_its_own_times(write_video: WriteVideo):
    video = write_video("a.mp4", options={"movflags": "faststart"})
    with served(video, length_told=True) as url:
        source = open_frames(url)
        seconds = [frame.timestamp for frame in source]
    assert (source.count, source.timestamp_source) == (30, "video")
    assert seconds == pytest.approx(0.04 * np.arange(30))


def test_the_clock_is_set_again_when_the_sender_starts_anew():
    clock = iter([100.0, 200.0, 300.0, 400.0])
    sent = [5.0, 5.5, 6.0, 1.0, 1.25, None, 9.0]
    shifted = list(in_wall_clock((Moment(seconds=time) for time in sent), lambda: next(clock)))
    assert [moment.seconds for moment in shifted] == [100, 100.5, 101, 200, 200.25, 300, 400]


@pytest.mark.parametrize(
    ("url", "public", "why"),
    [
        ("rtsp://user:secret@127.0.0.1:9/cam?key=secret", "rtsp://127.0.0.1:9/cam", "refused"),
        ("gopher://user:secret@host/cam", "gopher://host/cam", "unknown kind of stream"),
    ],
)
def test_what_does_not_answer_is_named_without_its_secrets(
    url: str, public: str, why: str, capfd: pytest.CaptureFixture[str]
):
    with pytest.raises(InputError, match=why) as caught:
        open_frames(url)
    assert caught.value.file == public
    assert "user:secret" not in "".join(traceback.format_exception(caught.value))
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("source", [0, "0"])
def test_a_camera_delivers_until_it_stops(
    write_video: WriteVideo, monkeypatch: pytest.MonkeyPatch, source: int | str
):
    """A recording stands in for the camera: the rest is OpenCV's own."""
    video, capture = write_video("a.mp4", count=5), cv2.VideoCapture
    asked: list[int] = []

    def play(index: int) -> cv2.VideoCapture:
        asked.append(index)
        return capture(str(video))

    monkeypatch.setattr(cv2, "VideoCapture", play)
    before = time.time()
    camera = open_frames(source)
    frames = list(camera)
    assert asked == [0]
    assert (camera.name, camera.count, camera.timestamp_source) == ("camera0", None, "wall clock")
    file_frames = list(open_frames(video))
    for frame, expected in zip(frames[:-1], file_frames, strict=True):
        assert frame.image is not None
        assert expected.image is not None
        assert np.corrcoef(frame.image.ravel(), expected.image.ravel())[0, 1] > 0.98
    assert frames[-1].image is None
    assert frames[-1].fault == "the camera delivers no more pictures"
    assert before <= frames[0].timestamp <= frames[-1].timestamp <= time.time()


def test_a_camera_is_released_when_reading_is_abandoned(
    write_video: WriteVideo, monkeypatch: pytest.MonkeyPatch
):
    capture = cv2.VideoCapture(str(write_video("a.mp4", count=5)))
    monkeypatch.setattr(cv2, "VideoCapture", lambda _: capture)
    frames = iter(open_frames(0))
    next(frames)
    assert capture.isOpened()
    frames.close()  # type: ignore[attr-defined]
    assert not capture.isOpened()


def test_no_camera(capfd: pytest.CaptureFixture[str]):
    with pytest.raises(InputError, match="source: no camera of index 987"):
        open_frames("987")
    assert capfd.readouterr().err == ""
