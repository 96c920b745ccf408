"""What hangs, or leads elsewhere: FIFOs, devices, playlists; and damage of every kind."""

from __future__ import annotations

import os
import random
import sys
import threading
import time
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import cv2
import numpy as np
import pytest

from farpoint.errors import InputError
from farpoint.frames import open_frames
from fuzz import fuzz_count

GREY = np.random.default_rng(0).integers(0, 256, (48, 64)).astype(np.uint8)
posix = pytest.mark.skipif(sys.platform == "win32", reason="needs FIFOs and devices")


def shots(folder: Path, count: int = 3) -> Path:
    folder.mkdir()
    for k in range(count):
        cv2.imwrite(str(folder / f"{k}.png"), GREY)
    return folder


@posix
@pytest.mark.parametrize("target", ["fifo", "/dev/zero", "/dev/tty", "/proc/self/mem"])
def test_an_image_that_never_ends_is_a_frame_with_a_fault(tmp_path: Path, target: str):
    folder = shots(tmp_path / "a")
    if target == "fifo":
        os.mkfifo(tmp_path / "fifo")
        target = str(tmp_path / "fifo")
    (folder / "1.png").unlink()
    (folder / "1.png").symlink_to(target)
    frames = list(open_frames(folder))
    assert [frame.image is None for frame in frames] == [False, True, False]


@posix
def test_a_list_of_times_that_never_ends(tmp_path: Path):
    folder = shots(tmp_path / "a")
    (folder / "times.txt").symlink_to("/dev/zero")
    assert len(list(open_frames(folder))) == 3
    os.mkfifo(tmp_path / "a" / "rgb.txt")
    assert len(list(open_frames(folder))) == 3


@posix
def test_a_source_that_never_ends(tmp_path: Path):
    os.mkfifo(tmp_path / "fifo.mp4")
    for source in (tmp_path / "fifo.mp4", Path("/dev/zero")):
        with pytest.raises(InputError, match="neither a file nor a folder"):
            open_frames(source)


PLAYLISTS = {
    "hls": "#EXTM3U\n#EXT-X-TARGETDURATION:10\n#EXTINF:10,\n{}\n#EXT-X-ENDLIST\n",
    "hls behind lines": "\n\n  #EXTM3U\n#EXTINF:10,\n{}\n",
    "concat": "ffconcat version 1.0\nfile {}\n",
    "concat without its mark": "file '{}'\n",
    "dash": '<?xml version="1.0"?><MPD type="static"><BaseURL>{}</BaseURL></MPD>',
    "sdp": "v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\nm=video 5004 RTP/AVP 96\r\n",
}


@pytest.mark.parametrize("suffix", [".m3u8", ".mp4", ".txt"])
@pytest.mark.parametrize("kind", PLAYLISTS)
def test_playlists_are_not_followed(tmp_path: Path, kind: str, suffix: str):
    path = tmp_path / f"list{suffix}"
    path.write_text(PLAYLISTS[kind].format("/etc/passwd"))
    with pytest.raises(InputError, match=r"is a playlist.*--follow-playlists"):
        open_frames(path)


def test_a_playlist_is_followed_where_asked_for(tmp_path: Path, write_clip):
    clip = write_clip(tmp_path / "clip.ts")
    path = tmp_path / "list.m3u8"
    path.write_text(PLAYLISTS["hls"].format(clip.name))
    followed = [frame.image for frame in open_frames(path, follow_playlists=True)]
    for image, frame in zip(followed, open_frames(clip), strict=False):
        np.testing.assert_array_equal(image, frame.image)
    assert len(followed) >= 6


@pytest.fixture
def write_clip():
    import av

    def write(path: Path, count: int = 6) -> Path:
        with av.open(str(path), "w") as out:
            stream = out.add_stream("mpeg4", rate=10)
            stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
            for k in range(count):
                image = np.roll(GREY, k, axis=1)
                frame = av.VideoFrame.from_ndarray(image, format="gray").reformat(format="yuv420p")
                out.mux(stream.encode(frame))
            out.mux(stream.encode())
        return path

    return write


def test_mutants_are_frames_faults_or_one_line(tmp_path: Path, write_clip):
    """Bytes changed and cut out in videos and images: an end within seconds, no traceback."""
    rng = random.Random(1)
    samples = {".mp4": write_clip(tmp_path / "a.mp4"), ".ts": write_clip(tmp_path / "a.ts")}
    for suffix in (".png", ".tif", ".jpg"):
        cv2.imwrite(str(tmp_path / f"b{suffix}"), GREY)
        samples[suffix] = tmp_path / f"b{suffix}"
    for k in range(fuzz_count(60)):
        suffix, sample = rng.choice(list(samples.items()))
        data = bytearray(sample.read_bytes())
        for _ in range(rng.choice((1, 5, 50))):
            data[rng.randrange(len(data))] = rng.randrange(256)
        if rng.random() < 0.4:
            begin = rng.randrange(len(data))
            del data[begin : begin + rng.randrange(1, 400)]
        place = tmp_path / f"m{k}"
        place.mkdir()
        (place / f"x{suffix}").write_bytes(data or b"\0")
        start = time.monotonic()
        assert outcome(place if suffix in (".png", ".tif", ".jpg") else place / f"x{suffix}")
        assert time.monotonic() - start < 10.0


@pytest.fixture
def serve(tmp_path: Path):
    """A server without ranges, on the loopback."""
    handler = partial(SimpleHTTPRequestHandler, directory=tmp_path)
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def test_a_recording_behind_a_server_without_ranges(tmp_path: Path, write_clip, serve: str):
    """The index of an MP4 stands at its end, as most programs write it."""
    clip = write_clip(tmp_path / "clip.mp4", 40)
    frames = list(open_frames(f"{serve}/clip.mp4"))
    there = list(open_frames(clip))
    assert [frame.timestamp for frame in frames] == [frame.timestamp for frame in there]
    for frame, same in zip(frames, there, strict=True):
        np.testing.assert_array_equal(frame.image, same.image)
    with pytest.raises(InputError, match="404"):
        open_frames(f"{serve}/nothing.mp4")


def test_a_large_one_is_refused_in_words(tmp_path: Path, write_clip, serve: str, monkeypatch):
    write_clip(tmp_path / "clip.mp4")
    monkeypatch.setattr("farpoint.frames.network._LARGEST_COPY_BYTES", 100)
    with pytest.raises(InputError, match=r"gives no parts of files.*download it first"):
        open_frames(f"{serve}/clip.mp4")


def outcome(source: Path) -> str:
    try:
        frames = list(open_frames(source))
    except InputError as error:
        return str(error) if str(error).isprintable() else ""
    assert all((frame.image is None) == (frame.fault is not None) for frame in frames)
    return "read"
