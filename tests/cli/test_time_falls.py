"""Recordings whose time goes back: clips joined one behind the other."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np
import pytest
from cli_kit import CAMERA, CommandLine, record_of, rows_of

from farpoint import Odometry
from farpoint.odometry.rising_time import RisingTime
from farpoint.trajectory.files import read_tum


def test_times_behind_a_fall_follow_the_ones_before():
    clock = RisingTime()
    given = [5.0, 5.2, 5.4, 1.0, 1.2, 0.0, 0.2, 0.2]
    found = [clock.update(time) for time in given]
    np.testing.assert_allclose(
        [time for time, _ in found], [5.0, 5.2, 5.4, 5.6, 5.8, 6.0, 6.2, 6.2]
    )
    assert [fell for _, fell in found] == [False, False, False, True, False, True, False, False]
    assert clock.falls == 2


def test_a_fall_begins_a_segment_and_no_result_goes_back(images: tuple[np.ndarray, ...]):
    odometry = Odometry(CAMERA)
    times = [*np.arange(6) / 10, *np.arange(6) / 10]
    results = [odometry.process(image, t) for image, t in zip(images, times, strict=True)]
    assert [result.segment for result in results] == [0] * 6 + [1] * 6
    assert results[6].pose is None  # nothing connects it with what came before
    assert (np.diff([result.timestamp for result in results]) > 0.0).all()
    assert len(odometry.notes) == 1


@pytest.mark.parametrize("joined", [1, 3])
def test_joined_transport_streams(
    joined: int,
    tmp_path: Path,
    calibration: Path,
    images: tuple[np.ndarray, ...],
    farpoint: CommandLine,
):
    parts = []
    for k in range(joined):
        path = tmp_path / f"part{k}.ts"
        with av.open(str(path), "w", format="mpegts") as out:
            stream = out.add_stream("mpeg2video", rate=10)
            stream.width, stream.height, stream.pix_fmt = CAMERA.size[0], CAMERA.size[1], "yuv420p"
            stream.codec_context.gop_size = 1
            stream.codec_context.bit_rate = 20_000_000
            for image in images[:8]:
                frame = av.VideoFrame.from_ndarray(image, format="gray").reformat(format="yuv420p")
                out.mux(stream.encode(frame))
            out.mux(stream.encode())
        parts.append(path.read_bytes())
    whole, out = tmp_path / "whole.ts", tmp_path / "out"
    whole.write_bytes(b"".join(parts))
    said = farpoint(
        "run", whole, "--camera", calibration, "--out", out, "--no-overlay", "--no-report"
    )
    assert said.code == 0
    notes = record_of(out)["notes"]
    assert len(notes) == (joined > 1)
    assert all(f"Time stamps fell {joined - 1} times" in note for note in notes)
    assert (np.diff(read_tum(out / "trajectory.tum").timestamps) > 0.0).all()
    times = np.array([[float(row["timestamp0"]), float(row["timestamp1"])] for row in rows_of(out)])
    assert (times[:, 1] > times[:, 0]).all()
    assert (np.diff(times[:, 0]) >= 0.0).all()
    assert farpoint("evaluate", out, "--truth", out / "trajectory.tum").code == 0
