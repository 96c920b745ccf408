"""Videos and folders on other file systems, by fsspec: the same frames as on this machine."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from io import BytesIO
from pathlib import Path
from threading import Thread
from typing import Any

import cv2
import fsspec
import numpy as np
import pytest
from bags_kit import KINDS, Kind, image_message, write_bag
from cli_kit import write_video

from farpoint.errors import InputError, MissingExtraError
from farpoint.frames import Frame, open_frames
from farpoint.frames.remote import open_remote_file

SEED = 7


@pytest.fixture
def pictures() -> list[np.ndarray]:
    rng = np.random.default_rng(SEED)
    return [rng.integers(0, 255, (48, 64), dtype=np.uint8) for _ in range(4)]


@pytest.fixture
def drive(tmp_path: Path, pictures: list[np.ndarray]) -> Path:
    """A folder with a folder of images with times, and a video."""
    shots = tmp_path / "drive" / "shots"
    shots.mkdir(parents=True)
    for number, picture in enumerate(pictures):
        cv2.imwrite(str(shots / f"{number}.png"), picture)
    (shots / "times.txt").write_text("".join(f"{5 + 0.25 * k}\n" for k in range(len(pictures))))
    write_video(tmp_path / "drive" / "film.mp4", pictures)
    return tmp_path / "drive"


@pytest.fixture(params=["memory", "file"])
def remote(request: pytest.FixtureRequest, drive: Path) -> Iterator[str]:
    """The same behind a URL."""
    if request.param == "file":
        yield f"file://{drive}"
        return
    system = fsspec.filesystem("memory")
    system.put(str(drive), "/drive", recursive=True)
    yield "memory://drive"
    system.rm("/drive", recursive=True)


def assert_equal_frames(source: str, local: Path) -> None:
    found, expected = open_frames(source), open_frames(local)
    assert found.name == expected.name
    for _ in range(2):  # it can be iterated again
        frames = list(found)
        assert [f.timestamp for f in frames] == [f.timestamp for f in expected]
        for frame, other in zip(frames, expected, strict=True):
            np.testing.assert_array_equal(frame.image, other.image)
    assert found.timestamp_source == expected.timestamp_source


def test_a_folder_elsewhere_is_read_like_one_here(remote: str, drive: Path):
    assert_equal_frames(f"{remote}/shots", drive / "shots")


def test_a_video_elsewhere_is_read_like_one_here(remote: str, drive: Path):
    assert_equal_frames(f"{remote}/film.mp4", drive / "film.mp4")


def test_the_copy_of_a_folder_goes_when_nobody_reads_it_any_more(
    remote: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    place = tmp_path / "temporary"
    place.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(place))
    frames = open_frames(f"{remote}/shots")
    assert len(list(frames)) == 4
    assert len(list(place.iterdir())) == 1
    del frames
    assert list(place.iterdir()) == []


@pytest.mark.parametrize("name", ["missing.mp4", "shots/times.txt"])
def test_what_is_no_source_is_one_line_with_its_url(remote: str, name: str):
    with pytest.raises(InputError) as caught:
        open_frames(f"{remote}/{name}")
    assert str(caught.value).startswith(f"{remote}/{name}: ")
    assert "\n" not in str(caught.value)


def test_an_unknown_scheme_is_named():
    with pytest.raises(InputError, match=r"nowhere://a\.mp4: .*nowhere"):
        open_frames("nowhere://a.mp4")


def test_without_fsspec_the_extra_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "fsspec", None)
    with pytest.raises(MissingExtraError, match=r"farpoint\[remote\]"):
        open_frames("s3://bucket/drive.mp4")


def test_a_file_elsewhere_is_opened_for_other_readers(remote: str, drive: Path):
    with open_remote_file(f"{remote}/film.mp4") as file:
        file.seek(4)
        assert file.read(4) == (drive / "film.mp4").read_bytes()[4:8]


def test_a_video_of_a_web_server_needs_no_fsspec(drive: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "fsspec", None)
    handler = partial(SimpleHTTPRequestHandler, directory=str(drive))
    monkeypatch.setattr(SimpleHTTPRequestHandler, "log_message", lambda *_: None)
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        url = f"http://127.0.0.1:{server.server_port}/film.mp4"
        found = list(open_frames(url))
        server.shutdown()
    for frame, other in zip(found, open_frames(drive / "film.mp4"), strict=True):
        np.testing.assert_array_equal(frame.image, other.image)


def test_images_of_a_web_server_are_read_by_fsspec(drive: Path, monkeypatch: pytest.MonkeyPatch):
    pytest.importorskip("aiohttp")
    handler = partial(SimpleHTTPRequestHandler, directory=str(drive))
    monkeypatch.setattr(SimpleHTTPRequestHandler, "log_message", lambda *_: None)
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        assert_equal_frames(f"http://127.0.0.1:{server.server_port}/shots/", drive / "shots")
        server.shutdown()


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_elsewhere_is_read_like_one_here(
    tmp_path: Path, pictures: list[np.ndarray], kind: Kind
):
    stamps = range(10**9, 5 * 10**9, 10**9)
    sent = [image_message(p, "mono8", t) for p, t in zip(pictures, stamps, strict=True)]
    bag = write_bag(tmp_path, kind, sent)
    assert_equal_frames(f"file://{bag}", bag)
    system = fsspec.filesystem("memory")
    system.put(str(bag), f"/bags/{bag.name}", recursive=True)
    assert_equal_frames(f"memory://bags/{bag.name}", bag)
    system.rm("/bags", recursive=True)


def test_a_bag_of_a_web_server_is_read_by_fsspec(
    tmp_path: Path, pictures: list[np.ndarray], monkeypatch: pytest.MonkeyPatch
):
    pytest.importorskip("aiohttp")
    bag = write_bag(tmp_path, "ros1", [image_message(p, "mono8", 10**9) for p in pictures])
    monkeypatch.setattr(SimpleHTTPRequestHandler, "log_message", lambda *_: None)
    handler = partial(SimpleHTTPRequestHandler, directory=str(tmp_path))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        assert_equal_frames(f"http://127.0.0.1:{server.server_port}/{bag.name}", bag)
        server.shutdown()


class _BreaksOff(SimpleHTTPRequestHandler):
    """Closes the connection in the middle of every file."""

    def copyfile(self, source: Any, outputfile: Any) -> None:
        data = source.read()
        is_list = data.startswith(b"<")
        outputfile.write(data if is_list else data[: len(data) // 2])


@pytest.mark.parametrize("name", ["drive/shots/", "drive.bag", "drive/film.mp4"])
def test_a_connection_that_breaks_off_is_one_line(
    drive: Path, pictures: list[np.ndarray], monkeypatch: pytest.MonkeyPatch, name: str
):
    pytest.importorskip("aiohttp")
    write_bag(drive.parent, "ros1", [image_message(p, "mono8", 10**9) for p in pictures])
    place = drive.parent / "temporary"
    place.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(place))
    monkeypatch.setattr(SimpleHTTPRequestHandler, "log_message", lambda *_: None)
    handler = partial(_BreaksOff, directory=str(drive.parent))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        url = f"http://127.0.0.1:{server.server_port}/{name}"
        with pytest.raises(InputError) as caught:
            list(open_frames(url))
        server.shutdown()
    assert str(caught.value).startswith(url)
    assert "\n" not in str(caught.value)
    assert list(place.iterdir()) == []


class _BrokenFile(BytesIO):
    """Fails at a byte, as a connection does that is lost."""

    def __init__(self, data: bytes, end: int) -> None:
        super().__init__(data)
        self._end = end

    def read(self, size: int | None = -1, /) -> bytes:
        if self.tell() >= self._end:
            raise RuntimeError("connection\nlost")
        return super().read(size)


@pytest.mark.parametrize("share", [0.0, 0.5, 0.9])
def test_a_connection_lost_in_a_video_ends_in_one_line(
    remote: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    share: float,
):
    rng = np.random.default_rng(SEED)
    pictures = [rng.integers(0, 255, (480, 640), dtype=np.uint8) for _ in range(8)]
    data = write_video(tmp_path / "film.mkv", pictures).read_bytes()
    monkeypatch.setattr(
        "farpoint.frames.remote.open_remote_file",
        lambda _: _BrokenFile(data, int(share * len(data))),
    )
    seen: list[Frame] = []
    with pytest.raises(InputError, match=r"film\.mp4: cannot be read: connection lost"):
        seen.extend(open_frames(f"{remote}/film.mp4"))
    assert bool(seen) == (share > 0)
    assert capfd.readouterr().err == ""
