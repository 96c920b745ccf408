"""Focal lengths that cameras left in images and videos."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import av
import pytest
from frames_kit import picture
from PIL import Image

from farpoint.camera import EquivalentFocalLength
from farpoint.errors import InputError
from farpoint.frames import find_focal_length, open_frames

EXIF_IFD, FOCAL_LENGTH_35MM = 0x8769, 0xA405
QUICKTIME = "com.apple.quicktime.camera.focal_length.35mm_equivalent"


def shoot(folder: Path, lengths: list[int | None], suffix: str = ".jpg") -> Path:
    """Images with these focal lengths in their EXIF; None for one without EXIF."""
    folder.mkdir()
    for number, length in enumerate(lengths):
        exif = Image.Exif()
        if length is not None:
            exif.get_ifd(EXIF_IFD)[FOCAL_LENGTH_35MM] = length
        image = Image.fromarray(picture(number))
        image.save(folder / f"{number:04d}{suffix}", exif=exif.tobytes() if length else b"")
    return folder


def video_with(path: Path, metadata: dict[str, str]) -> Path:
    options = {"movflags": "use_metadata_tags"}
    with av.open(str(path), "w", options=options) as container:
        container.metadata.update(metadata)
        stream = container.add_stream("mpeg4", rate=10)
        stream.width, stream.height, stream.pix_fmt = 158, 120, "yuv420p"
        for number in range(3):
            frame = av.VideoFrame.from_ndarray(picture(number), format="gray")
            container.mux(stream.encode(frame.reformat(format="yuv420p")))
        container.mux(stream.encode())
    return path


def found(source: Path) -> EquivalentFocalLength:
    return find_focal_length(open_frames(str(source)), str(source))


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif"])
def test_images_carry_it_in_their_exif(tmp_path: Path, suffix: str):
    guess = found(shoot(tmp_path / "shots", [28, 28, 28], suffix))
    assert guess == EquivalentFocalLength(millimetres=28.0, source="EXIF")


def test_images_without_are_passed_over(tmp_path: Path):
    folder = shoot(tmp_path / "shots", [None, 0, 26, None])
    (folder / "0004.jpg").write_bytes(b"this is not an image")
    assert found(folder).millimetres == 26.0


def test_a_long_sequence_is_looked_at_all_along(tmp_path: Path):
    folder = shoot(tmp_path / "shots", 40 * [26] + 10 * [77])
    with pytest.raises(InputError, match="several focal lengths, 26 to 77 mm"):
        found(folder)


def test_images_that_carry_none(write_images: Callable[..., Path]):
    folder = write_images("shots", ["a.png", "b.png"])
    with pytest.raises(InputError, match=r"--camera: EXIF of a.png has no .*--fov"):
        found(folder)


def test_a_video_of_a_phone_carries_it(tmp_path: Path):
    guess = found(video_with(tmp_path / "phone.mov", {QUICKTIME: "27"}))
    assert guess == EquivalentFocalLength(millimetres=27.0, source="the video's metadata")


@pytest.mark.parametrize("said", [None, "wide", "0", "-3", "nan", "inf"])
def test_a_video_that_carries_none(tmp_path: Path, said: str | None):
    path = video_with(tmp_path / "drive.mov", {} if said is None else {QUICKTIME: said})
    with pytest.raises(InputError, match=r"drive\.mov: --camera: carries no focal length.*--fov"):
        found(path)


def test_a_live_source_carries_none():
    class Live:
        pass

    with pytest.raises(InputError, match="0: --camera: a live source"):
        find_focal_length(Live(), "0")  # type: ignore[arg-type]
