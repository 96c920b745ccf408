"""Video files: exact luma, true times, upright, and every way in which a file can be broken."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from frames_kit import HEIGHT, WIDTH, picture, without_rights

from farpoint.errors import InputError
from farpoint.frames import Frame, open_frames

WriteVideo = Callable[..., Path]


def ten_bits(number: int) -> np.ndarray:
    return picture(number).astype(np.uint16) * 4 + 3


def sixteen_bits(number: int) -> np.ndarray:
    return picture(number).astype(np.uint16) * 256 + 255


@pytest.mark.parametrize(
    ("name", "codec", "pixel_format", "luma"),
    [
        ("a.mkv", "ffv1", "yuv420p", picture),
        ("a.mkv", "ffv1", "yuv444p", picture),
        ("a.mkv", "ffv1", "gray", picture),
        ("a.nut", "rawvideo", "nv12", picture),
        ("a.nut", "rawvideo", "yuvj420p", picture),
        ("a.mkv", "ffv1", "yuv422p10le", ten_bits),
        ("a.mkv", "ffv1", "gray10le", ten_bits),
        ("a.mkv", "ffv1", "gray16le", sixteen_bits),
    ],
)
def test_luma_is_taken_as_it_is_stored(
    write_video: WriteVideo,
    name: str,
    codec: str,
    pixel_format: str,
    luma: Callable[[int], np.ndarray],
):
    video = write_video(name, codec=codec, pixel_format=pixel_format, luma=luma, count=3)
    frames = list(open_frames(video))
    for number, frame in enumerate(frames):
        assert frame.image is not None
        assert frame.image.flags.c_contiguous
        assert frame.image.flags.owndata
        np.testing.assert_array_equal(frame.image, picture(number))
    assert len(frames) == 3


@pytest.mark.parametrize(
    ("name", "codec", "pixel_format"),
    [
        ("a.mkv", "ffv1", "bgr0"),
        ("a.nut", "rawvideo", "rgb24"),
        ("a.avi", "rawvideo", "bgr24"),  # stored from the bottom up
        ("a.mov", "png", "rgb24"),
    ],
)
def test_rgb_becomes_luma(tmp_path: Path, name: str, codec: str, pixel_format: str):
    colour = np.stack([picture(1), picture(2), picture(3)], axis=-1)
    with av.open(str(tmp_path / name), "w") as container:
        stream = container.add_stream(codec, rate=25)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, pixel_format
        frame = av.VideoFrame.from_ndarray(colour, format="rgb24").reformat(format=pixel_format)
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    (frame,) = open_frames(tmp_path / name)
    luma = colour @ [0.299, 0.587, 0.114]  # BT.601
    np.testing.assert_allclose(frame.image, luma, atol=2)


def test_packed_and_palette_pictures_are_converted(tmp_path: Path):
    yuyv = av.VideoFrame(WIDTH, HEIGHT, "yuyv422")
    packed = np.full((HEIGHT, yuyv.planes[0].line_size), 128, np.uint8)
    packed[:, : 2 * WIDTH : 2] = picture(0)
    yuyv.planes[0].update(packed.tobytes())
    with av.open(str(tmp_path / "a.nut"), "w") as container:
        stream = container.add_stream("rawvideo", rate=25)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuyv422"
        container.mux(stream.encode(yuyv))
    (frame,) = open_frames(tmp_path / "a.nut")
    # Limited range stretched to the full one by FFmpeg.
    stretched = (picture(0).astype(float) - 16) * 255 / 219
    np.testing.assert_allclose(frame.image, stretched.clip(0, 255), atol=2)

    palette = av.VideoFrame(WIDTH, HEIGHT, "pal8")
    indices = np.zeros((HEIGHT, palette.planes[0].line_size), np.uint8)
    indices[:, :WIDTH] = 255 - picture(0)  # into a palette from white to black
    palette.planes[0].update(indices.tobytes())
    colours = np.repeat(np.arange(255, -1, -1).astype(np.uint8)[:, None], 4, axis=1)
    palette.planes[1].update(colours.tobytes())
    with av.open(str(tmp_path / "a.mov"), "w") as container:
        stream = container.add_stream("png", rate=25)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "pal8"
        container.mux(stream.encode(palette))
    (frame,) = open_frames(tmp_path / "a.mov")
    np.testing.assert_allclose(frame.image, picture(0), atol=2)


@pytest.mark.parametrize("name", ["a.mkv", "a.mp4", "a.mov"])
def test_times_of_a_variable_rate_are_true(write_video: WriteVideo, name: str):
    milliseconds = [500, 533, 567, 900, 933, 2100, 2101, 2140]
    source = open_frames(write_video(name, milliseconds=milliseconds))
    seconds = [frame.timestamp for frame in source]
    # MP4 keeps an offset at the start as an edit list of its own resolution.
    assert seconds == pytest.approx([time / 1000 for time in milliseconds], abs=1e-3)
    assert source.timestamp_source == "video"


def test_count_and_names(write_video: WriteVideo):
    for name in ("a.mp4", "a.mkv", "a.avi", "a.ts"):
        video = write_video(name, codec="mpeg4" if name == "a.avi" else "libx264")
        source = open_frames(video, fps=7)  # does not override what the file tells
        frames = list(source)
        assert (source.name, source.count, len(frames)) == ("a", 30, 30)
        assert [frame.name for frame in frames] == [str(number) for number in range(30)]
        assert np.diff([frame.timestamp for frame in frames]) == pytest.approx(0.04)
        assert [frame.index for frame in source] == list(range(30))  # and again


@pytest.mark.parametrize(("name", "codec"), [("a.avi", "mpeg4"), ("a.mkv", "libx264")])
def test_pictures_left_out_are_not_missing(write_video: WriteVideo, name: str, codec: str):
    """An AVI that leaves out pictures counts them in its header: it is whole all the same."""
    milliseconds = [0, 40, 80, 800, 840, 880]
    frames = list(open_frames(write_video(name, codec=codec, milliseconds=milliseconds)))
    assert [frame.timestamp for frame in frames] == pytest.approx([t / 1000 for t in milliseconds])
    assert all(frame.fault is None for frame in frames)


def test_a_stream_without_times_takes_the_rate(write_video: WriteVideo):
    video = write_video("a.h264", count=5)
    assert open_frames(video).count is None
    assert open_frames(video, fps=20).timestamp_source == "20 frames a second"
    seconds = [frame.timestamp for frame in open_frames(video, fps=20)]
    assert seconds == pytest.approx([0, 0.05, 0.1, 0.15, 0.2])


def with_display_matrix(video: Path, matrix: tuple[int, int, int, int]) -> Path:
    """Write ``a b c d`` into the track header (ISO 14496-12, tkhd, version 0)."""
    data = bytearray(video.read_bytes())
    start = data.index(b"tkhd") + 4 + 40
    for place, value in zip((0, 1, 3, 4), matrix, strict=True):
        data[start + 4 * place : start + 4 * place + 4] = (value << 16).to_bytes(
            4, "big", signed=True
        )
    video.write_bytes(data)
    return video


@pytest.mark.parametrize(
    ("matrix", "upright"),
    [
        ((1, 0, 0, 1), lambda image: image),
        ((0, 1, -1, 0), lambda image: np.rot90(image, -1)),
        ((-1, 0, 0, -1), lambda image: np.rot90(image, 2)),
        ((0, -1, 1, 0), lambda image: np.rot90(image, 1)),
        ((-1, 0, 0, 1), np.fliplr),
        ((1, 0, 0, -1), np.flipud),
        ((0, 1, 1, 0), np.transpose),
        ((0, -1, -1, 0), lambda image: np.rot90(image, 2).T),
    ],
)
def test_pictures_are_upright(
    write_video: WriteVideo,
    matrix: tuple[int, int, int, int],
    upright: Callable[[np.ndarray], np.ndarray],
):
    plain = next(iter(open_frames(write_video("plain.mp4", count=2)))).image
    assert plain is not None
    turned = with_display_matrix(write_video("turned.mp4", count=2), matrix)
    for frame in open_frames(turned):
        assert frame.image is not None
        assert frame.image.flags.c_contiguous
    np.testing.assert_array_equal(next(iter(open_frames(turned))).image, upright(plain))


@pytest.mark.parametrize("matrix", [(0, 1, -1, 0), (-1, 0, 0, -1), (0, -1, 1, 0)])
def test_turns_agree_with_opencv(write_video: WriteVideo, matrix: tuple[int, int, int, int]):
    video = with_display_matrix(write_video("turned.mp4", count=2), matrix)
    ours = next(iter(open_frames(video))).image
    theirs = cv2.cvtColor(cv2.VideoCapture(str(video)).read()[1], cv2.COLOR_BGR2GRAY)
    assert ours is not None
    assert ours.shape == theirs.shape
    assert np.corrcoef(ours.ravel(), theirs.ravel())[0, 1] > 0.98


def images_of(frames: list[Frame]) -> dict[float, bytes]:
    return {frame.timestamp: frame.image.tobytes() for frame in frames if frame.image is not None}


@pytest.mark.parametrize("keep", [0.3, 0.6, 0.9])
@pytest.mark.parametrize(
    ("name", "codec", "options"),
    [
        ("a.mp4", "libx264", {"movflags": "faststart"}),
        ("a.avi", "mjpeg", {}),
        ("a.mkv", "ffv1", {}),
        ("a.ts", "libx264", {}),
    ],
)
def test_a_truncated_video_gives_the_frames_it_has(
    write_video: WriteVideo,
    capfd: pytest.CaptureFixture[str],
    keep: float,
    name: str,
    codec: str,
    options: dict[str, str],
):
    pixel_format = "yuvj420p" if codec == "mjpeg" else "yuv420p"
    video = write_video(name, codec=codec, pixel_format=pixel_format, options=options, count=100)
    whole = images_of(list(open_frames(video)))
    video.write_bytes(video.read_bytes()[: int(video.stat().st_size * keep)])
    frames = list(open_frames(video))
    there = images_of(frames)
    # The first pictures take more of the bytes than their share.
    assert max(0.2, 0.5 * keep) <= len(there) / len(whole) < 1
    # MPEG-TS tells neither that more was to come nor that the last picture is incomplete.
    assert set(list(there.items())[: -1 if name == "a.ts" else None]) <= set(whole.items())
    # A Matroska header tells a duration only, in which sound counts: a second may lack unnoticed.
    if name in ("a.mp4", "a.avi") or (name == "a.mkv" and keep < 0.7):
        assert frames[-1].image is None
        assert "the video ends at" in str(frames[-1].fault)
    assert [frame.index for frame in frames] == list(range(len(frames)))
    assert all(before.timestamp < after.timestamp for before, after in pairwise(frames))
    assert capfd.readouterr().err == ""


def damage_packets(video: Path, numbers: set[int], *, skip: int = 0) -> list[float]:
    """Overwrite the content of packets (in storage order) with noise; their times, s."""
    data, rng, seconds = bytearray(video.read_bytes()), np.random.default_rng(0), []
    with av.open(str(video)) as container:
        for number, packet in enumerate(container.demux(video=0)):
            if number in numbers:
                content = bytes(packet)
                start = data.index(content) + skip
                end = start + len(content) - skip
                data[start:end] = rng.integers(0, 256, end - start, np.uint8).tobytes()
                seconds.append(float(packet.pts * packet.time_base))
    video.write_bytes(data)
    return seconds


def test_a_damaged_packet_is_one_fault_and_reading_goes_on(
    write_video: WriteVideo, capfd: pytest.CaptureFixture[str]
):
    video = write_video("a.mkv", codec="ffv1", count=12)
    whole = images_of(list(open_frames(video)))
    seconds = damage_packets(video, {4, 5, 9})
    frames = list(open_frames(video))
    assert [frame.timestamp for frame in frames] == list(whole)
    assert [frame.timestamp for frame in frames if frame.image is None] == seconds
    assert all("cannot be decoded" in str(frames[k].fault) for k in (4, 5, 9))
    assert images_of(frames).items() <= whole.items()
    assert capfd.readouterr().err == ""


def test_a_picture_decoded_in_part_is_a_fault(write_video: WriteVideo):
    video = write_video("a.avi", codec="mpeg4", count=12)
    damage_packets(video, {0}, skip=600)
    first, *others = open_frames(video)
    assert first.image is None
    assert "only in part" in str(first.fault)
    assert len(others) == 11


def test_faults_stand_at_their_time_among_reordered_pictures(write_video: WriteVideo):
    def several_b_frames(stream: Any) -> None:
        stream.options = {"g": "100", "bf": "3", "b_strategy": "0"}

    video = write_video("a.mp4", count=40, prepare=several_b_frames)
    with av.open(str(video)) as container:
        stored = [packet.pts for packet in container.demux(video=0) if packet.pts is not None]
    assert stored != sorted(stored)
    seconds = damage_packets(video, {17, 18, 19}, skip=4)
    frames = list(open_frames(video))
    assert sorted(frame.timestamp for frame in frames if frame.image is None) == sorted(seconds)
    assert len(frames) == 40
    assert all(before.timestamp < after.timestamp for before, after in pairwise(frames))


@pytest.mark.parametrize(
    ("name", "content", "why"),
    [
        ("a.mp4", b"", "cannot be opened as a video"),
        ("a.mp4", b"this is no video " * 100, "cannot be opened as a video"),
        ("notes.txt", b"hello\n" * 100, "is a text or one image"),
        ("a", bytes(1000), "cannot be opened as a video"),
    ],
)
def test_files_that_are_no_videos(
    tmp_path: Path, name: str, content: bytes, why: str, capfd: pytest.CaptureFixture[str]
):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=why) as caught:
        open_frames(tmp_path / name)
    assert caught.value.file == str(tmp_path / name)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr().err == ""


def test_a_video_without_its_index_or_without_a_picture(write_video: WriteVideo):
    video = write_video("a.mp4")
    video.write_bytes(video.read_bytes()[:-600])  # the index is at the end
    with pytest.raises(InputError, match="truncated"):
        open_frames(video)
    video = write_video("a.avi", codec="mpeg4")
    video.write_bytes(video.read_bytes()[:6000])  # the header and a part of the first picture
    with pytest.raises(InputError, match="holds no picture"):
        open_frames(video)


def test_sound_is_no_video(tmp_path: Path):
    path = tmp_path / "a.wav"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=8000, layout="mono")
        silence = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), "s16", "mono")
        silence.sample_rate = 8000
        container.mux(stream.encode(silence))
    with pytest.raises(InputError, match="holds no video"):
        open_frames(path)


def test_a_video_without_rights_is_named(write_video: WriteVideo):
    video = write_video("a.mp4", count=2)
    with without_rights(video), pytest.raises(InputError, match=r"a\.mp4.*Permission denied"):
        open_frames(video)


def test_metadata_may_hold_any_bytes(write_video: WriteVideo):
    video = write_video("a.mkv", count=2)
    with av.open(str(video)) as container:
        encoder = container.metadata["ENCODER"].encode()
    content = video.read_bytes()
    assert encoder in content
    video.write_bytes(content.replace(encoder, len(encoder) * b"\xff"))
    assert len(list(open_frames(str(video)))) == 2


def test_names_that_look_like_protocols(write_video: WriteVideo, monkeypatch: pytest.MonkeyPatch):
    video = write_video("12:30 größe.mp4", count=2)
    monkeypatch.chdir(video.parent)
    assert len(list(open_frames(video.name))) == 2


def test_a_calibration_of_the_same_name_comes_first(write_video: WriteVideo):
    video = write_video("drive.mp4", count=2)
    assert open_frames(video).calibration_path is None
    for name in ("calib.txt", "drive.yaml"):
        (video.parent / name).write_text("")
    assert open_frames(video).calibration_path == video.parent / "drive.yaml"


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="open files are listed in /proc")
def test_the_file_is_closed_when_reading_is_abandoned(write_video: WriteVideo):
    video = write_video("a.mp4")

    def is_open() -> bool:
        links = Path("/proc/self/fd").iterdir()
        return any(link.is_symlink() and link.readlink() == video for link in links)

    frames = iter(open_frames(video))
    assert not is_open()
    next(frames)
    assert is_open()
    frames.close()  # type: ignore[attr-defined]
    assert not is_open()


def test_memory_does_not_grow_with_the_length(write_video: WriteVideo):
    def peak(count: int) -> int:
        source = open_frames(write_video(f"{count}.mp4", count=count))
        tracemalloc.start()
        for _ in source:
            pass
        _, highest = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return highest

    peak(30)  # what is loaded on first use
    assert peak(240) < peak(30) + 10 * WIDTH * HEIGHT


@pytest.mark.parametrize("aspect", ["1:1", "4:3", "8:9"])
def test_pixels_that_are_not_square(tmp_path: Path, aspect: str):
    path = tmp_path / "wide.mkv"
    wide, high = map(int, aspect.split(":"))
    with av.open(str(path), "w") as out:
        stream = out.add_stream("mpeg4", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        stream.codec_context.sample_aspect_ratio = Fraction(wide, high)
        for _ in range(2):
            image = np.zeros((48, 64), np.uint8)
            frame = av.VideoFrame.from_ndarray(image, format="gray").reformat(format="yuv420p")
            out.mux(stream.encode(frame))
        out.mux(stream.encode())
    assert open_frames(path).pixel_aspect == pytest.approx(wide / high)
