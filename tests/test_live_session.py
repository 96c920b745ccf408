"""A live session with faults ends with valid files, a true account and no more memory."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import av
import numpy as np
import pytest

from farpoint.bench.live_session import LiveTrial, try_live
from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.frames import Frame
from farpoint.frames.live import Disconnect, Playback
from farpoint.live import LiveSession, LiveState
from farpoint.sinks import OutputOptions, ViewerOptions
from farpoint.sinks.motions import read_motions
from memory import peak_bytes

CAMERA = Camera.pinhole(160, 96, 120.0, 120.0, 79.5, 47.5)
BARE = OutputOptions(overlay=False, report=False, halves_every=0)


def noise(count: int, gap_s: float, camera: Camera = CAMERA) -> Playback:
    """Frames of a texture that shifts, at so many seconds from one to the next."""
    assert camera.size is not None
    width, height = camera.size
    rng = np.random.default_rng(3)
    large = np.kron(rng.integers(0, 255, (40, 60), np.uint8), np.ones((6, 6), np.uint8))
    views = [large[k : k + height, k : k + width].copy() for k in range(9)]
    # Each is made when its time comes, as a camera does: who keeps it pays for it.
    return Playback(
        frames=(
            Frame(index=k, timestamp=k * gap_s, image=views[k % 9].copy(), name=str(k))
            for k in range(count)
        )
    )


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("live") / "out"


@pytest.fixture(scope="module")
def trial(out: Path) -> LiveTrial:
    """The bench's session, shortened to some seconds, with every output on."""
    pytest.importorskip("rerun.chunk")
    return try_live(5.0, out, output=OutputOptions())


def test_everything_is_accounted_for(trial: LiveTrial):
    assert len(trial.claims) >= 10
    for claim in trial.claims:
        assert claim.found == claim.expected, claim.what
    assert trial.state.account.taken > 20


def test_black_frames_fail_and_say_why(trial: LiveTrial, out: Path):
    assert 0 < trial.failed <= trial.black
    reasons = json.loads((out / "run.json").read_text())["reasons"]
    assert "shows nothing to track" in " ".join(told["reason"] for told in reasons)


def test_silence_is_reported(trial: LiveTrial):
    assert trial.state.account.longest_silence_s >= 0.2


def test_frames_are_counted_as_the_source_delivered_them(tmp_path: Path):
    class Noted(Playback):
        def __iter__(self) -> Iterator[Frame]:
            for frame in super().__iter__():
                stamps.append(frame.timestamp)
                yield frame

    stamps: list[float] = []
    playback = Noted(frames=noise(60, 0.01).frames)
    with LiveSession(playback, "noise", CAMERA, tmp_path / "out", output=BARE) as session:
        session.run(notice=lambda _: time.sleep(0.05))  # too slow for every frame
    motions = read_motions(tmp_path / "out" / "motions.csv")
    assert session.state.account.dropped > 10
    for times, frames in (
        (motions.timestamp0, motions.frame0),
        (motions.timestamp1, motions.frame1),
    ):
        np.testing.assert_array_equal(times, np.array(stamps)[frames])


def test_the_video_shows_every_frame_used(trial: LiveTrial, out: Path):
    with av.open(str(out / "overlay.mp4")) as film:
        pictures = sum(1 for _ in film.decode(video=0))
    assert pictures == trial.state.account.taken


def test_memory_does_not_grow_with_the_length(tmp_path: Path):
    def peak(count: int) -> int:
        playback = noise(count, 0.004)
        with LiveSession(playback, "noise", CAMERA, tmp_path / "out", output=BARE) as session:
            return peak_bytes(session.run)

    peak(500)  # most of what is loaded on use; what few frames need comes later, and once
    short = min(peak(50) for _ in range(2))
    # What grows with the length does so each time.
    assert any(peak(500) - short < 0.05 * 450 * 160 * 96 for _ in range(3))


def test_the_end_of_a_recording_ends_the_session(tmp_path: Path):
    playback = noise(12, 0.01)
    with LiveSession(playback, "noise", CAMERA, tmp_path / "out", output=BARE) as session:
        session.run()
    assert session.state.account.captured == playback.delivered == 12
    assert json.loads((tmp_path / "out" / "run.json").read_text())["state"] == "done"


def test_a_lost_source_is_reported_while_it_is_lost(tmp_path: Path):
    playback = noise(400, 0.01)
    playback.endless, playback.faults = True, (Disconnect(at_s=0.4, for_s=0.3),)
    links: list[str] = []

    def notice(state: LiveState) -> None:
        links.append(state.link)

    with LiveSession(playback, "noise", CAMERA, tmp_path / "out", output=BARE) as session:
        session.run(2.0, notice)
    kept = [links[0]] + [b for a, b in pairwise(links) if a != b]
    assert kept == ["receiving", "lost", "receiving"]


def test_an_error_closes_the_files(tmp_path: Path):
    def fail(_: LiveState) -> None:
        raise RuntimeError("out of luck")

    with (
        pytest.raises(RuntimeError),
        LiveSession(noise(50, 0.01), "noise", CAMERA, tmp_path / "out", output=BARE) as session,
    ):
        session.run(notice=fail)
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert record["state"] == "failed"
    assert record["live"]["taken"] == 1
    assert record["live"]["captured"] == record["live"]["taken"] + record["live"]["dropped"]


def test_pictures_of_another_size_replace_nothing(tmp_path: Path):
    other = Camera.pinhole(200, 96, 120.0, 120.0, 79.5, 47.5)
    with pytest.raises(InputError) as caught:
        LiveSession(noise(5, 0.01), "noise", other, tmp_path / "out")
    assert caught.value.field == "camera"
    assert not (tmp_path / "out").exists()


def test_a_source_without_pictures_is_named(tmp_path: Path):
    with pytest.raises(InputError, match="playback: delivers no picture"):
        LiveSession(Playback(frames=[]), "nothing", CAMERA, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_display_shows_delays_and_link(tmp_path: Path):
    reader = pytest.importorskip("rerun.chunk").RrdReader
    rrd = tmp_path / "a.rrd"
    playback = noise(30, 0.01)
    with LiveSession(
        playback, "noise", CAMERA, tmp_path / "out", output=BARE, viewer=ViewerOptions(rrd=rrd)
    ) as session:
        session.run()
    rows = {"/delays": [], "/status/source": []}
    for part in reader(rrd).stream():
        if part.entity_path in rows and not part.is_static:
            rows[part.entity_path] += part.to_record_batch().to_pylist()
    delays = np.array([row["Scalars:scalars"] for row in rows["/delays"]])
    account = session.state.account
    assert len(delays) == account.taken
    assert delays[:, 0].max() == pytest.approx(1e3 * session.state.longest_latency_s)
    assert 0 <= account.dropped - delays[:, 1].sum() <= 1  # the last may be dropped at the end
    assert [row["StateChange:state"] for row in rows["/status/source"]] == [["receiving"]]
