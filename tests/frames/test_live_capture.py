"""Frames as they happen: the newest wins, lost sources come back, nothing goes uncounted."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from farpoint.errors import InputError
from farpoint.frames import Frame
from farpoint.frames.live import (
    Black,
    Capture,
    Disconnect,
    LiveAccount,
    Playback,
    Stall,
    capture,
    open_live,
)

PATIENCE_S = 20.0
WriteVideo = Callable[..., Path]


@pytest.fixture(autouse=True)
def _quick_retries(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(capture, "_RETRY_S", 0.02)


def picture(index: int) -> Frame:
    image = np.full((4, 6), index, np.uint8)
    return Frame(index=0, timestamp=float(index), image=image, name=str(index))


BROKEN = Frame(index=0, timestamp=0.0, image=None, name="broken", fault="cannot be decoded")


@dataclass
class Connection:
    """Delivers frames at once, waits for a word, delivers the later ones, and ends or fails."""

    frames: Iterable[Frame]
    later: Iterable[Frame] = ()
    error: Exception | None = None
    go_on: threading.Event = field(default_factory=threading.Event)
    name: str = "scripted"
    count: int | None = None
    timestamp_source: str = "wall clock"
    calibration_path: Path | None = None
    notes: tuple[str, ...] = ()
    pixel_aspect: float = 1.0

    def __iter__(self) -> Iterator[Frame]:
        yield from self.frames
        assert self.go_on.wait(PATIENCE_S)
        yield from self.later
        if self.error is not None:
            raise self.error


@dataclass
class Scripted:
    """A source whose openings are given in advance; an error among them is raised."""

    openings: list[Connection | Exception]
    endless: bool = True

    def open(self) -> Any:
        opening = self.openings.pop(0) if self.openings else InputError("gone", field="source")
        if isinstance(opening, Exception):
            raise opening
        return opening


def wait_until(holds: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.005)


def accounted(account: LiveAccount) -> int:
    return account.taken + account.dropped + account.broken + account.waiting


def test_the_newest_frame_wins_and_the_others_are_counted():
    connection = Connection([picture(index) for index in range(5)])
    with Capture(Scripted([connection])) as live:
        wait_until(lambda: live.account.captured == 5)
        assert (live.account.dropped, live.account.waiting) == (4, 1)
        assert live.peek(0.0) is not None  # stays
        taken = live.take(PATIENCE_S)
        assert taken is not None
        assert (taken.frame.index, taken.frame.timestamp, taken.dropped) == (4, 4.0, 4)
        assert live.take(0.01) is None
        assert accounted(live.account) == live.account.captured
        connection.go_on.set()
    assert live.account.taken == 1


def test_what_waits_at_the_end_was_dropped():
    connection = Connection([picture(0)])
    live = Capture(Scripted([connection]))
    wait_until(lambda: live.account.waiting == 1)
    connection.go_on.set()
    live.close()
    assert live.ended
    assert (live.account.waiting, live.account.dropped) == (0, 1)


def test_a_broken_frame_takes_nobodys_place():
    connection = Connection([picture(0), BROKEN, BROKEN])
    with Capture(Scripted([connection])) as live:
        wait_until(lambda: live.account.captured == 3)
        taken = live.take(PATIENCE_S)
        assert taken is not None
        assert taken.frame.image is not None
        assert (live.account.broken, live.account.dropped) == (2, 0)
        connection.go_on.set()


@pytest.mark.parametrize(
    ("end", "told"),
    [
        (Connection([picture(0)]), "no more frames"),
        (Connection([picture(0)], error=OSError("USB reset")), "OSError: USB reset"),
        (Connection([picture(0), BROKEN]), "cannot be decoded"),
    ],
    ids=["ends", "raises", "faults"],
)
def test_a_lost_source_comes_back(end: Connection, told: str):
    again = Connection([picture(7)])
    attempts = [InputError("gone", field="source"), RuntimeError("driver"), again]
    with Capture(Scripted([end, *attempts])) as live:
        assert live.take(PATIENCE_S) is not None
        assert live.connected
        end.go_on.set()
        taken = live.take(PATIENCE_S)
        assert taken is not None
        assert taken.frame.timestamp == 7.0
        assert taken.frame.index == live.account.captured - 1  # counted over both connections
        account = live.account
        assert (account.disconnects, account.reconnects) == (1, 1)
        assert told in str(account.last_fault)
        again.go_on.set()


def test_a_source_that_stays_away_leaves_the_session_alone():
    end = Connection([picture(0)])
    end.go_on.set()
    with Capture(Scripted([end])) as live:
        wait_until(lambda: not live.connected)
        assert not live.ended
        assert live.take(PATIENCE_S) is not None
        assert live.take(0.05) is None


def test_a_recording_has_an_end():
    connection = Connection([picture(0)])
    connection.go_on.set()
    with Capture(Scripted([connection], endless=False)) as live:
        assert live.take(PATIENCE_S) is not None
        assert live.take(PATIENCE_S) is None
        assert live.ended
        assert live.account.disconnects == 0


def test_a_source_that_hangs_is_left_behind(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(capture, "_FAREWELL_S", 0.05)
    connection = Connection([picture(0)], later=[picture(1)])
    live = Capture(Scripted([connection]))
    wait_until(lambda: live.account.captured == 1)
    live.close()  # its thread still waits
    before = live.account
    connection.go_on.set()
    wait_until(lambda: not live._thread.is_alive())
    assert live.account == before  # final, whatever still came


def test_the_first_opening_must_succeed():
    with pytest.raises(InputError, match="gone"):
        Capture(Scripted([]))


def test_a_recording_is_played_at_its_own_pace():
    frames = [Frame(index=k, timestamp=0.03 * k, image=None, name="") for k in range(6)]
    playback = Playback(frames=frames)
    start = time.monotonic()
    wall = time.time()
    stamps = [frame.timestamp for frame in playback.open()]
    assert time.monotonic() - start >= 5 * 0.03
    assert np.diff(stamps).min() > 0.0
    assert wall <= stamps[0] <= stamps[-1] <= time.time()
    assert playback.delivered == 6


def test_faults_come_when_they_are_due():
    frames = [picture(1 + k % 9) for k in range(10)]
    frames = [
        Frame(index=k, timestamp=0.01 * k, image=f.image, name="") for k, f in enumerate(frames)
    ]
    playback = Playback(
        frames=frames,
        endless=True,
        loop=True,
        faults=(
            Black(at_s=0.1, for_s=0.1),
            Stall(at_s=0.3, for_s=0.2),
            Disconnect(at_s=0.7, for_s=0.3),
        ),
    )
    start = time.monotonic()
    arrivals = []
    for frame in playback.open():
        assert frame.image is not None
        assert time.monotonic() - start < PATIENCE_S
        arrivals.append((time.monotonic() - start, bool(frame.image.any())))
    dark = [when for when, seen in arrivals if not seen]
    assert len(dark) == playback.black > 0
    assert min(dark) >= 0.1
    assert np.diff([when for when, _ in arrivals]).max() >= 0.15  # the stall
    assert not [when for when, _ in arrivals if 0.35 < when < 0.5]
    with pytest.raises(InputError, match="unplugged"):
        playback.open()
    wait_until(lambda: time.monotonic() - start > 1.0)
    assert next(iter(playback.open())).image is not None
    assert playback.delivered == len(arrivals) + 1


def test_a_camera_is_unplugged_and_plugged_in_again(
    write_video: WriteVideo, monkeypatch: pytest.MonkeyPatch
):
    """Recordings stand in for the camera: it ends, is away for three attempts, and is back."""
    video, nothing, capture_of = write_video("a.mp4", count=5), "nothing.mp4", cv2.VideoCapture
    openings = [str(video), nothing, nothing, nothing, str(video)]
    monkeypatch.setattr(cv2, "VideoCapture", lambda _: capture_of(openings.pop(0)))
    with Capture(open_live("0")) as live:
        wait_until(lambda: live.account.reconnects == 1 and live.account.disconnects == 2)
        assert openings == []
        assert live.account.captured == 2 * (5 + 1)
        assert live.account.broken == 2
        assert "no more pictures" in str(live.account.last_fault)
        assert live.name == "camera0"


def test_a_recording_behind_a_url_has_its_pace_and_its_end(monkeypatch: pytest.MonkeyPatch):
    recording = Connection(
        [picture(0), picture(0)], timestamp_source="video", notes=("deep",), pixel_aspect=2.0
    )
    recording.go_on.set()
    monkeypatch.setattr("farpoint.frames.live.source.open_frames", lambda _, **__: recording)
    source = open_live("http://127.0.0.1/a.mp4")
    with Capture(source) as live:
        wait_until(lambda: live.account.captured == 2)
        assert live.take(PATIENCE_S) is not None
        wait_until(lambda: live.ended)
    assert live.account.disconnects == 0
    assert live.timestamp_source == "wall clock"
    assert (live.notes, live.pixel_aspect) == (("deep",), 2.0)


def test_only_recordings_are_played(tmp_path: Path, write_video: WriteVideo):
    assert isinstance(open_live(str(write_video("a.mp4", count=3)), loop=True), Playback)
    assert open_live("rtsp://127.0.0.1/cam").endless
    with pytest.raises(InputError, match="no such file"):
        open_live(str(tmp_path / "missing.mp4"))
