"""Folders and patterns of images: order, time stamps, laziness, and faults in the middle."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from frames_kit import encode, picture, without_rights
from hypothesis import given
from hypothesis import strategies as st

import farpoint.frames.sequence
from farpoint.errors import InputError
from farpoint.frames import open_frames
from farpoint.frames.files import natural_key, source_name

WriteImages = Callable[..., Path]


def names_of(source: str | Path, **options: float) -> list[str]:
    return [frame.name for frame in open_frames(source, **options)]


def seconds_of(source: str | Path, **options: float) -> list[float]:
    return [frame.timestamp for frame in open_frames(source, **options)]


def test_frames_are_the_images_in_natural_order(write_images: WriteImages):
    folder = write_images("drive", [f"img{number}.png" for number in range(12)])
    source = open_frames(folder)
    frames = list(source)
    assert (source.name, source.count) == ("drive", 12)
    assert [frame.name for frame in frames] == [f"img{number}.png" for number in range(12)]
    assert [frame.index for frame in frames] == list(range(12))
    for number, frame in enumerate(frames):
        np.testing.assert_array_equal(frame.image, picture(number))
        assert frame.fault is None
    assert [frame.name for frame in source] == [frame.name for frame in frames]  # and again


@given(st.sets(st.integers(0, 10**6), min_size=1))
def test_natural_order_of_counters_is_that_of_numbers(numbers: set[int]):
    shuffled = random.Random(0).sample(sorted(numbers), len(numbers))
    names = sorted((f"Frame {number}.png" for number in shuffled), key=natural_key)
    assert names == [f"Frame {number}.png" for number in sorted(numbers)]


@given(st.lists(st.text("aé10٣.", max_size=6), unique=True))
def test_natural_order_does_not_depend_on_where_one_starts(names: list[str]):
    backwards = names[::-1]
    assert sorted(names, key=natural_key) == sorted(backwards, key=natural_key)


def test_only_images_count(write_images: WriteImages):
    folder = write_images("drive", ["a.png", "b.JPG", "._a.png"])
    (folder / "notes.md").write_text("no image")
    (folder / "c.png").mkdir()
    assert names_of(folder) == ["a.png", "b.JPG"]


def test_pattern_chooses_among_images(write_images: WriteImages, monkeypatch: pytest.MonkeyPatch):
    folder = write_images("shots", ["left_2.png", "left_10.png", "right_2.png"])
    (folder / "left_5.txt").write_text("no image")
    assert names_of(str(folder / "left_*[0-9].*")) == ["left_2.png", "left_10.png"]
    assert names_of(folder / "**" / "r*.png") == ["right_2.png"]
    monkeypatch.chdir(folder)
    assert open_frames("left*.png").name == "shots"


def test_a_folder_with_a_pattern_in_its_name_is_a_folder(write_images: WriteImages):
    assert names_of(write_images("drive [1]", ["a.png"])) == ["a.png"]


@pytest.mark.parametrize("inside", ["images", "rgb", "anything"])
def test_images_one_folder_down_are_found(write_images: WriteImages, inside: str):
    folder = write_images(f"drive/{inside}", ["a.png"]).parent
    assert open_frames(folder).name == "drive"
    assert names_of(folder) == ["a.png"]


def test_several_folders_of_images_are_a_question(write_images: WriteImages):
    folder = write_images("drive/left", ["a.png"]).parent
    write_images("drive/right", ["a.png"])
    with pytest.raises(InputError, match=r"drive: several folders.*one of left, right"):
        open_frames(folder)


def test_relative_and_home_paths(write_images: WriteImages, monkeypatch: pytest.MonkeyPatch):
    folder = write_images("drive", ["a.png"])
    monkeypatch.chdir(folder)
    assert open_frames(".").name == "drive"
    monkeypatch.setenv("HOME", str(folder.parent))
    assert names_of("~/drive") == ["a.png"]


@pytest.mark.parametrize(
    ("folder", "name"),
    [
        ("drive/images", "drive"),
        ("drive/Images", "drive"),
        ("drive/rgb", "drive"),
        ("drive/image_0", "drive"),
        ("drive/image_00/data", "drive"),
        ("drive/mav0/cam0/data", "drive"),
        ("drive/image_2", "drive-image_2"),
        ("drive/image_01/data", "drive-image_01"),
        ("drive/mav0/cam1/data", "drive-cam1"),
        ("drive/right", "drive-right"),
        ("drive/datas", "datas"),
    ],
)
def test_the_name_of_a_source_tells_sequences_apart(
    write_images: WriteImages, folder: str, name: str
):
    place = write_images(folder, ["a.png"])
    assert open_frames(place).name == name
    assert open_frames(str(place / "*.png")).name == name
    other = write_images(folder.replace("drive", "other"), ["a.png"])
    assert open_frames(other).name == name.replace("drive", "other")


def test_where_no_folder_above_has_a_name_its_own_is_taken():
    assert source_name(Path("/data/images")) == "data"
    assert source_name(Path("/cam1")) == "cam1"
    assert source_name(Path("/")) == ""


def test_images_are_decoded_one_at_a_time(
    write_images: WriteImages, monkeypatch: pytest.MonkeyPatch
):
    folder = write_images("drive", [f"{number}.png" for number in range(5)])
    decoded: list[str] = []
    read_samples = farpoint.frames.sequence.read_samples

    def spy(path: Path, most: float) -> np.ndarray:
        decoded.append(path.name)
        return read_samples(path, most)

    monkeypatch.setattr(farpoint.frames.sequence, "read_samples", spy)
    frames = iter(open_frames(folder))
    assert decoded == []
    next(frames)
    assert decoded == ["0.png"]


def test_what_cannot_be_read_is_a_fault_and_reading_goes_on(
    write_images: WriteImages, capfd: pytest.CaptureFixture[str]
):
    folder = write_images("drive", [f"{number}.png" for number in range(7)])
    (folder / "1.png").write_bytes(b"")
    (folder / "3.png").write_bytes((folder / "3.png").read_bytes()[:400])
    (folder / "4.png").unlink()
    (folder / "4.png").symlink_to(folder / "nowhere.png")
    with without_rights(folder / "5.png"):
        frames = list(open_frames(folder))
    assert [frame.index for frame in frames] == list(range(7))
    assert [frame.timestamp for frame in frames] == pytest.approx([0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    faults = {frame.name: frame.fault for frame in frames if frame.image is None}
    assert list(faults) == ["1.png", "3.png", "4.png", "5.png"]
    for name, why in zip(faults, ("empty", "truncated", "no such file", "denied"), strict=True):
        assert why in str(faults[name])
    np.testing.assert_array_equal(frames[6].image, picture(6))
    assert capfd.readouterr().err == ""


def test_images_of_another_size_are_passed_on(write_images: WriteImages):
    folder = write_images("drive", ["0.png", "1.png", "2.png"])
    (folder / "1.png").write_bytes(encode(picture(1)[:50, :60], ".png"))
    shapes = [frame.image.shape for frame in open_frames(folder) if frame.image is not None]
    assert shapes == [picture(0).shape, (50, 60), picture(0).shape]


def test_sources_that_are_not_there(tmp_path: Path, write_images: WriteImages):
    (tmp_path / "empty").mkdir()
    folder = write_images("drive", ["a.png"])
    for source, why in {
        tmp_path / "missing": "no such file or folder",
        tmp_path / "empty": "holds no images",
        tmp_path / "*.png": "matches no images",
        folder / "a.png": "is one image",
        folder / "a.png" / "b": "no such file or folder",
        "/dev/null": "neither a file nor a folder",
    }.items():
        with pytest.raises(InputError, match=why) as caught:
            open_frames(source)
        assert caught.value.file == str(source)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("source", ["", None, True, 1.5])
def test_what_is_no_source_is_refused(source: object):
    with pytest.raises(InputError, match="source: expected a file"):
        open_frames(source)  # type: ignore[arg-type]


def test_a_folder_without_rights_is_named(write_images: WriteImages):
    folder = write_images("drive", ["a.png"])
    with without_rights(folder), pytest.raises(InputError, match=r"drive.*Permission denied"):
        open_frames(folder)


@pytest.mark.parametrize("fps", [0, -1, float("nan"), float("inf"), 1e300, 1e-9])
def test_impossible_rates_are_refused(write_images: WriteImages, fps: float):
    with pytest.raises(InputError, match=r"fps: expected 1e-06 to 1e\+06 frames a second"):
        open_frames(write_images("drive", ["a.png"]), fps=fps)


@pytest.mark.parametrize(
    ("files", "expected"),
    [
        ({"calib.txt", "notes.txt", "readme.yaml"}, "calib.txt"),
        ({"images/camera.yaml", "calib.txt"}, "images/camera.yaml"),
        (
            {"calib/cam0_sensor.yaml", "calib/cam1_sensor.yaml", "imu.yaml"},
            "calib/cam0_sensor.yaml",
        ),
        ({"calib_TUM1.yaml"}, "calib_TUM1.yaml"),
        ({"notes.txt", "imu0.yaml", "groundtruth.txt"}, None),
    ],
)
def test_a_calibration_nearby_is_pointed_out(
    write_images: WriteImages, files: set[str], expected: str | None
):
    folder = write_images("drive/images", ["a.png"]).parent
    (folder / "calib").mkdir()
    for name in files:
        (folder / name).write_text("")
    found = open_frames(folder).calibration_path
    assert found == (None if expected is None else folder / expected)
