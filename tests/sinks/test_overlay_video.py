"""overlay.mp4: true times, the right codec, readable when killed, the same bytes every time."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest

from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.odometry import OdometryResult
from farpoint.sinks.overlay import OverlayVideo, draw_overlay
from farpoint.sinks.overlay.layout import Layout
from farpoint.sinks.overlay.video import KEYFRAME_INTERVAL

MakeResult = Callable[..., OdometryResult]
IMAGE = np.tile(np.arange(640, dtype=np.uint16) // 3, (480, 1)).astype(np.uint8)


def film(path: Path, camera: Camera, results: list[OdometryResult]) -> None:
    video = OverlayVideo(path, camera)
    for result in results:
        video.write(result, IMAGE)
    video.close()
    video.close()


def frames_of(path: Path) -> list[av.VideoFrame]:
    with av.open(str(path)) as container:
        return list(container.decode(video=0))


def test_it_is_what_browsers_play_with_the_times_of_the_frames(
    tmp_path: Path, camera: Camera, make_result: MakeResult
) -> None:
    uneven = [100.0, 100.033, 100.1, 103.5, 103.6]
    results = [replace(make_result(k), timestamp=stamp) for k, stamp in enumerate(uneven)]
    film(tmp_path / "overlay.mp4", camera, results)
    with av.open(str(tmp_path / "overlay.mp4")) as container:
        codec = container.streams.video[0].codec_context
        layout = Layout.of_image(640, 480)
        assert (codec.name, codec.pix_fmt) == ("h264", "yuv420p")
        assert (codec.width, codec.height) == (layout.width, layout.height)
    times = [frame.time for frame in frames_of(tmp_path / "overlay.mp4")]
    np.testing.assert_allclose(times, np.array(uneven) - uneven[0], atol=1e-5)


def test_the_film_shows_the_picture(
    tmp_path: Path, camera: Camera, make_result: MakeResult
) -> None:
    film(tmp_path / "overlay.mp4", camera, [make_result(k) for k in range(3)])
    decoded = frames_of(tmp_path / "overlay.mp4")[2].to_ndarray(format="rgb24").astype(float)
    drawn = draw_overlay(IMAGE, make_result(2), camera).astype(float)
    assert np.abs(decoded - drawn).mean() < 4.0


def test_clocks_that_stand_or_run_back_do_not_stop_it(
    tmp_path: Path, camera: Camera, make_result: MakeResult
) -> None:
    stamps = [5.0, 5.0, 4.0, 5.2]
    results = [replace(make_result(k), timestamp=stamp) for k, stamp in enumerate(stamps)]
    film(tmp_path / "overlay.mp4", camera, results)
    times = [frame.time for frame in frames_of(tmp_path / "overlay.mp4")]
    assert len(times) == 4
    assert np.all(np.diff(times) > 0)


def test_a_killed_run_leaves_all_but_the_last_fragment(
    tmp_path: Path, camera: Camera, make_result: MakeResult
) -> None:
    written = 2 * KEYFRAME_INTERVAL + 3
    video = OverlayVideo(tmp_path / "overlay.mp4", camera)
    for k in range(written):
        video.write(make_result(k), IMAGE)
    # What a kill at this moment leaves is what another process sees now.
    shutil.copy(tmp_path / "overlay.mp4", tmp_path / "killed.mp4")
    video.close()
    assert len(frames_of(tmp_path / "killed.mp4")) >= written - KEYFRAME_INTERVAL
    assert len(frames_of(tmp_path / "overlay.mp4")) == written


def test_same_frames_same_bytes(tmp_path: Path, camera: Camera, make_result: MakeResult) -> None:
    results = [make_result(k) for k in range(20)]
    film(tmp_path / "a.mp4", camera, results)
    film(tmp_path / "b.mp4", camera, results)
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()


def test_missing_images_and_a_camera_without_size(
    tmp_path: Path, camera: Camera, make_result: MakeResult
) -> None:
    video = OverlayVideo(tmp_path / "overlay.mp4", replace(camera, size=None))
    for k, image in enumerate([None, IMAGE, None, IMAGE]):
        video.write(make_result(k), image)
    video.close()
    assert len(frames_of(tmp_path / "overlay.mp4")) == 3


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path, camera: Camera) -> None:
    with pytest.raises(InputError, match=r"gone/overlay\.mp4: cannot be written"):
        OverlayVideo(tmp_path / "gone" / "overlay.mp4", camera)


def test_an_empty_run_closes(tmp_path: Path, camera: Camera) -> None:
    film(tmp_path / "overlay.mp4", camera, [])
