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


def video(path: Path, camera: Camera, results: list[OdometryResult]) -> None:
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
    video(tmp_path / "overlay.mp4", camera, results)
    with av.open(str(tmp_path / "overlay.mp4")) as container:
        codec = container.streams.video[0].codec_context
        layout = Layout.of_image(640, 480)
        assert (codec.name, codec.pix_fmt) == ("h264", "yuv420p")
        assert (codec.width, codec.height) == (layout.width, layout.height)
    times = [frame.time for frame in frames_of(tmp_path / "overlay.mp4")]
    np.testing.assert_allclose(times, np.array(uneven) - uneven[0], atol=1e-5)


def test_the_video_shows_the_picture(
    tmp_path: Path, camera: Camera, make_result: MakeResult
) -> None:
    video(tmp_path / "overlay.mp4", camera, [make_result(k) for k in range(3)])
    decoded = frames_of(tmp_path / "overlay.mp4")[2].to_ndarray(format="rgb24").astype(float)
    drawn = draw_overlay(IMAGE, make_result(2), camera).astype(float)
    assert np.abs(decoded - drawn).mean() < 4.0


def test_clocks_that_stand_or_run_back_do_not_stop_it(
    tmp_path: Path, camera: Camera, make_result: MakeResult
) -> None:
    stamps = [5.0, 5.0, 4.0, 5.2]
    results = [replace(make_result(k), timestamp=stamp) for k, stamp in enumerate(stamps)]
    video(tmp_path / "overlay.mp4", camera, results)
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
    video(tmp_path / "a.mp4", camera, results)
    video(tmp_path / "b.mp4", camera, results)
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
    video(tmp_path / "overlay.mp4", camera, [])


def boxes(path: Path) -> list[str]:
    """Names of the top boxes of an MP4 file (ISO/IEC 14496-12), in their order."""
    data, names, at = path.read_bytes(), [], 0
    while at < len(data):
        size = int.from_bytes(data[at : at + 4], "big")
        names.append(data[at + 4 : at + 8].decode())
        at += size
    return names


def test_a_finished_video_has_one_index_in_front_and_the_same_pictures(
    tmp_path: Path, camera: Camera, make_result: MakeResult
) -> None:
    video = OverlayVideo(tmp_path / "overlay.mp4", camera)
    for k in range(2 * KEYFRAME_INTERVAL + 1):
        video.write(make_result(k), IMAGE)
    shutil.copy(tmp_path / "overlay.mp4", tmp_path / "killed.mp4")
    video.close()
    assert "moof" in boxes(tmp_path / "killed.mp4")
    packed = boxes(tmp_path / "overlay.mp4")
    assert "moof" not in packed
    assert packed.index("moov") < packed.index("mdat")
    assert {path.name for path in tmp_path.iterdir()} == {"overlay.mp4", "killed.mp4"}
    with av.open(str(tmp_path / "overlay.mp4")) as video:
        assert video.duration is not None
        assert video.duration / av.time_base == pytest.approx(2 * KEYFRAME_INTERVAL / 10, abs=0.11)
    before, after = frames_of(tmp_path / "killed.mp4"), frames_of(tmp_path / "overlay.mp4")
    assert len(before) == 2 * KEYFRAME_INTERVAL
    for old, new in zip(before, after, strict=False):
        np.testing.assert_array_equal(old.to_ndarray(), new.to_ndarray())
        assert old.time == new.time


def test_a_video_that_cannot_be_rewritten_stays_unchanged(
    tmp_path: Path, camera: Camera, make_result: MakeResult
) -> None:
    (tmp_path / "overlay.mp4.part").mkdir()  # where the packed film would be written
    video = OverlayVideo(tmp_path / "overlay.mp4", camera)
    for k in range(4):
        video.write(make_result(k), IMAGE)
    video.close()
    assert len(frames_of(tmp_path / "overlay.mp4")) == 4
