"""Sequences of known layouts, made up and real."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from frames_kit import picture

from farpoint.errors import InputError
from farpoint.frames import open_frames

WriteImages = Callable[..., Path]
NANOSECONDS = [1403715273262142976 + 50_000_000 * number for number in range(4)]


def contents(folder: Path) -> list[tuple[str, float]]:
    return [(frame.name, frame.timestamp) for frame in open_frames(folder)]


@pytest.mark.parametrize("cameras", ["image_0 image_1 image_2", "image_2 image_3"])
def test_kitti_odometry_takes_the_left_camera(write_images: WriteImages, cameras: str):
    for camera in cameras.split():
        home = write_images(f"07/{camera}", [f"00000{number}.png" for number in range(3)]).parent
    (home / "times.txt").write_text("0\n1.04e-01\n2.07e-01\n")
    (home / "calib.txt").write_text("P0: 1\n")
    source = open_frames(home)
    assert (source.name, source.timestamp_source) == ("07", "times.txt")
    assert contents(home) == [("000000.png", 0), ("000001.png", 0.104), ("000002.png", 0.207)]
    assert source.calibration_path == home / "calib.txt"
    assert getattr(source, "images")[0].parent.name == cameras.split()[0]  # noqa: B009


def test_kitti_raw(write_images: WriteImages):
    data = write_images("day/drive/image_00/data", ["0000000000.png", "0000000001.png"])
    write_images("day/drive/image_01/data", ["0000000000.png"])
    (data.parent / "timestamps.txt").write_text(
        "2011-09-26 13:02:25.964389445\n2011-09-26 13:02:26.074343000\n"
    )
    drive = data.parents[1]
    (drive.parent / "calib_cam_to_cam.txt").write_text("")
    for folder in (drive, data.parent, data):
        (first, start), (_, end) = contents(folder)
        assert first == "0000000000.png"
        assert end - start == pytest.approx(0.109953555, abs=1e-6)
        assert open_frames(folder).timestamp_source == "timestamps.txt"
    assert open_frames(drive).calibration_path == drive.parent / "calib_cam_to_cam.txt"


@pytest.mark.parametrize(
    ("images", "table", "given"),
    [
        ("mav0/cam0/data", "mav0/cam0/data.csv", "."),
        ("mav0/cam0/data", "mav0/cam0/data.csv", "mav0"),
        ("mav0/cam1/data", "mav0/cam1/data.csv", "mav0/cam1"),
        ("images", "cam0_data.csv", "."),
    ],
)
def test_euroc(write_images: WriteImages, tmp_path: Path, images: str, table: str, given: str):
    # Names that tell nothing, so that the times can only come from the table.
    write_images(f"V1/{images}", [f"{number}.png" for number in range(4)])
    rows = [f"{time},{number}.png\r\n" for number, time in enumerate(NANOSECONDS)]
    (tmp_path / "V1" / table).write_text("#timestamp [ns],filename\r\n" + "".join(rows))
    (tmp_path / "V1" / table).with_name("sensor.yaml").write_text("")
    source = open_frames(tmp_path / "V1" / given)
    assert source.timestamp_source == Path(table).name
    assert [frame.timestamp for frame in source] == [time / 10**9 for time in NANOSECONDS]
    assert [frame.name for frame in source] == [f"{number}.png" for number in range(4)]
    assert source.calibration_path == (tmp_path / "V1" / table).with_name("sensor.yaml")


@pytest.mark.parametrize(
    ("table", "row"),
    [
        ("rgb.txt", "{time} rgb/{name}"),
        ("images.txt", "{time} rgb/{name}"),
        ("images.txt", "{number} {time} rgb/{name}"),  # UZH-FPV
    ],
)
def test_tum(write_images: WriteImages, table: str, row: str):
    home = write_images("fr1/rgb", [f"{number}.png" for number in range(3)]).parent
    write_images("fr1/depth", [f"{number}.png" for number in range(3)])
    rows = [
        row.format(number=number, time=7 + number / 4, name=f"{number}.png") for number in range(3)
    ]
    (home / table).write_text("\n".join(["# color images", "# timestamp filename", *rows]))
    assert contents(home) == [("0.png", 7), ("1.png", 7.25), ("2.png", 7.5)]
    assert open_frames(home).timestamp_source == table


def test_a_list_is_cut_to_the_part_that_is_there(write_images: WriteImages):
    home = write_images("fr1/rgb", ["3.png", "4.png", "6.png"]).parent
    (home / "rgb.txt").write_text("".join(f"{number} rgb/{number}.png\n" for number in range(9)))
    frames = list(open_frames(home))
    assert [(frame.index, frame.timestamp) for frame in frames] == [(0, 3), (1, 4), (2, 5), (3, 6)]
    assert [frame.fault for frame in frames if frame.image is None] == [
        "no such file; expected an image"
    ]
    np.testing.assert_array_equal(frames[3].image, picture(2))


@pytest.mark.parametrize(
    ("rows", "why"),
    [
        (["0 rgb/0.png", "one rgb/1.png"], "line 2: expected a time and an image"),
        (["0 rgb/0.png", "1"], "line 2: expected a time and an image"),
        (["0 rgb/0.png", "-1 rgb/1.png"], "line 2: time -1 s lies before"),
        (["0 elsewhere/0.png"], "lists 1 images, none of which is there"),
    ],
)
def test_impossible_lists_are_named_by_file_and_line(
    write_images: WriteImages, rows: list[str], why: str
):
    home = write_images("fr1/rgb", ["0.png", "1.png"]).parent
    (home / "rgb.txt").write_text("\n".join(rows))
    with pytest.raises(InputError, match=rf"rgb\.txt: {why}"):
        open_frames(home)


def test_a_colmap_model_beside_the_images_is_no_list(write_images: WriteImages):
    home = write_images("scene/images", ["0.png"]).parent
    (home / "images.txt").write_text("# Image list\n1 1 0 0 0 0 0 0 1 0.png\n10.0 20.0 -1\n")
    assert open_frames(home).timestamp_source == "10 frames a second, assumed"


@pytest.mark.parametrize(
    ("folder", "count", "size", "times", "calibration"),
    [
        ("kitti_00", 130, (376, 1241), "10 frames a second, assumed", "calib.txt"),
        ("kitti_a", 51, (370, 1226), "10 frames a second, assumed", "calib.txt"),
        ("hololens", 80, (360, 540), "10 frames a second, assumed", "K.txt"),
        ("tum_fr1_rpy", 70, (480, 640), "file names", "calib_TUM1_orbslam2.yaml"),
        ("euroc_v101_micro", 25, (480, 752), "cam0_data.csv", "cam0_sensor.yaml"),
        ("davis_slider_depth", 87, (180, 240), "images.txt", "calib.txt"),
        (
            "kimera_fisheye_pair",
            2,
            (480, 752),
            "10 frames a second, assumed",
            "left_sensor_fisheye.yaml",
        ),
    ],
)
def test_real_sequences(
    shared_data: Path, folder: str, count: int, size: tuple[int, int], times: str, calibration: str
):
    source = open_frames(shared_data / folder)
    assert (source.name, source.count, source.timestamp_source) == (folder, count, times)
    assert source.calibration_path is not None
    assert source.calibration_path.name == calibration
    seconds = []
    for frame in source:
        assert frame.image is not None
        assert frame.image.shape == size
        assert frame.image.dtype == np.uint8
        assert frame.image.std() > 5
        seconds.append(frame.timestamp)
    assert len(seconds) == count
    assert 0.01 < np.diff(seconds).min() <= np.diff(seconds).max() < 0.2
