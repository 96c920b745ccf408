"""Trajectory files: exact round trips, evo as the oracle, and damage that names its line."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from evo.tools import file_interface
from scipy.spatial.transform import Rotation

from farpoint.errors import InputError
from farpoint.trajectory import files


def some_trajectory(count: int = 7) -> files.Trajectory:
    rng = np.random.default_rng(3)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.random(count, random_state=5).as_matrix()
    poses[:, :3, 3] = rng.normal(scale=40.0, size=(count, 3))
    stamps = 1403715273.262142976 + np.arange(count) / 30.0
    return files.Trajectory(timestamps=stamps, world_from_body=poses)


def test_tum_round_trip_keeps_times_and_positions_to_the_last_bit(tmp_path: Path) -> None:
    written = some_trajectory()
    files.write_tum(tmp_path / "a.tum", written)
    read = files.read_tum(tmp_path / "a.tum")
    np.testing.assert_array_equal(read.timestamps, written.timestamps)
    np.testing.assert_array_equal(read.world_from_body[:, :3, 3], written.world_from_body[:, :3, 3])
    np.testing.assert_allclose(read.world_from_body, written.world_from_body, atol=1e-15)


def test_kitti_round_trip_is_exact(tmp_path: Path) -> None:
    written = some_trajectory()
    files.write_kitti(tmp_path / "poses.txt", written)
    read = files.read_kitti(tmp_path / "poses.txt")
    assert read.timestamps is None
    np.testing.assert_array_equal(read.world_from_body, written.world_from_body)


def test_evo_reads_what_we_write(tmp_path: Path) -> None:
    written = some_trajectory()
    files.write_tum(tmp_path / "a.tum", written)
    files.write_kitti(tmp_path / "a.txt", written)
    tum = file_interface.read_tum_trajectory_file(tmp_path / "a.tum")
    kitti = file_interface.read_kitti_poses_file(tmp_path / "a.txt")
    np.testing.assert_array_equal(tum.timestamps, written.timestamps)
    np.testing.assert_allclose(np.stack(tum.poses_se3), written.world_from_body, atol=1e-14)
    np.testing.assert_allclose(np.stack(kitti.poses_se3), written.world_from_body, atol=1e-14)


def test_euroc_quaternion_is_wxyz_and_time_is_nanoseconds(tmp_path: Path) -> None:
    path = tmp_path / "data.csv"
    path.write_text(
        "#timestamp, p_x, p_y, p_z, q_w, q_x, q_y, q_z, v_x\n"
        "1403715273262142976,1.0,2.0,3.0,0.5,0.1,-0.7,0.5,9.9\n"
    )
    read = files.read_euroc(path)
    assert read.timestamps is not None
    assert read.timestamps[0] == 1403715273.262142976
    np.testing.assert_allclose(
        read.world_from_body[0, :3, :3],
        Rotation.from_quat([0.1, -0.7, 0.5, 0.5]).as_matrix(),
        atol=1e-12,
    )
    np.testing.assert_array_equal(read.world_from_body[0, :3, 3], [1.0, 2.0, 3.0])


def test_real_truth_of_every_kind_is_recognised_and_read_as_evo_reads_it(
    shared_data: Path,
) -> None:
    tum = shared_data / "tum_fr1_rpy" / "groundtruth.txt"
    kitti = shared_data / "kitti_00" / "poses.txt"
    euroc = shared_data / "euroc_v101_micro" / "groundtruth_openvins_V1_01_easy.csv"
    for path, oracle in (
        (tum, file_interface.read_tum_trajectory_file(tum).poses_se3),
        (kitti, file_interface.read_kitti_poses_file(kitti).poses_se3),
        (euroc, file_interface.read_euroc_csv_trajectory(euroc).poses_se3),
    ):
        read = files.read_trajectory(path)
        np.testing.assert_allclose(read.world_from_body, np.stack(oracle), atol=1e-5)
    assert len(files.read_trajectory(shared_data / "hololens" / "poses.txt")) == 373


GOOD_TUM = "0.0 0 0 0 0 0 0 1\n"
GOOD_KITTI = "1 0 0 0 0 1 0 0 0 0 1 0\n"
DAMAGED = {
    "cell is a word": (GOOD_TUM + "1.0 0 0 x 0 0 0 1\n", "line 2: expected a number, got 'x'"),
    "row cut off": (GOOD_TUM + "1.0 0 0 0\n", "line 2: expected 8 numbers"),
    "not finite": (GOOD_TUM + "1.0 0 nan 0 0 0 0 1\n", "line 2: expected finite"),
    "no unit quaternion": ("# head\n0.0 0 0 0 0 0 0 0\n", "line 2: expected a unit quaternion"),
    "time goes back": ("5.0 0 0 0 0 0 0 1\n" + GOOD_TUM, "line 2: expected a time of at least"),
    "mirror": (GOOD_KITTI + "-1 0 0 0 0 1 0 0 0 0 1 0\n", "line 2: expected a rotation"),
    "kitti row cut off": (GOOD_KITTI + "1 0 0\n", "line 2: expected 12 numbers"),
    "other columns": ("1 2 3\n", "line 1: expected 8 numbers (TUM)"),
    "no row": ("# only a comment\n\n", "found no row of numbers"),
    "euroc cut off": ("1,2,3\n", "line 1: expected 8 numbers (t[ns]"),
    "euroc in seconds": ("1,0,0,0,1,0,0,0\n1.5,0,0,0,1,0,0,0\n", "line 2: expected whole nanosec"),
    "huge position": (GOOD_TUM + "1.0 0 1e300 0 0 0 0 1\n", "line 2: expected positions of at"),
    "huge kitti position": (GOOD_KITTI + "1 0 0 1e300 0 1 0 0 0 0 1 0\n", "line 2: expected posi"),
    "huge matrix": (GOOD_KITTI + "1e300 0 0 0 0 1 0 0 0 0 1 0\n", "line 2: expected a rotation"),
    "scaled bottom row": (
        GOOD_KITTI.replace("\n", " 0 0 0 2\n"),
        "line 1: expected 0 0 0 1 as the last row of a 4x4 matrix, got 0 0 0 2",
    ),
    "column by column": (
        "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n1 0 0 0 0 1 0 0 0 0 1 0 4 5 6 1\n",
        "line 2: expected 0 0 0 1 as the last row of a 4x4 matrix, got 4 5 6 1",
    ),
    "an endless line": (GOOD_TUM + " " * 70_000, "line 2: expected a trajectory, got a line of"),
    "empty cell": (GOOD_TUM + "1.0,0,,0,0,0,0,1\n", "line 2: expected a number, got ''"),
    "words below numbers": (GOOD_TUM + "t x y z qx qy qz qw\n", "line 2: expected a number"),
}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("line_end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("separator", [",", ", ", ";", "\t", "  "])
@pytest.mark.parametrize("columns", [8, 12])
def test_every_separator_line_end_and_byte_order_mark_is_read(
    tmp_path: Path, encoding: str, line_end: str, separator: str, columns: int
) -> None:
    row = "0.5 1 2 3 0 0 0 1" if columns == 8 else "1 0 0 1 0 1 0 2 0 0 1 3"
    names = separator.join(f"name{k}" for k in range(columns))
    lines = ["# made", names, row.replace(" ", separator), "", ""]
    path = tmp_path / "truth.txt"
    path.write_bytes(line_end.join(lines).encode(encoding))
    read = files.read_trajectory(path)
    np.testing.assert_array_equal(read.world_from_body[:, :3, 3], [[1.0, 2.0, 3.0]])
    np.testing.assert_array_equal(read.world_from_body[:, :3, :3], [np.eye(3)])


@pytest.mark.parametrize("damage", DAMAGED)
def test_damage_names_file_and_line(tmp_path: Path, damage: str) -> None:
    text, message = DAMAGED[damage]
    path = tmp_path / "truth.txt"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        files.read_trajectory(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_and_binary_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere\.txt: no such file; expected a traj"):
        files.read_trajectory(tmp_path / "nowhere.txt")
    (tmp_path / "image.png").write_bytes(b"\x89PNG\r\n\xff\xfe\x00")
    with pytest.raises(InputError, match="expected a trajectory, a text file"):
        files.read_trajectory(tmp_path / "image.png")


def test_a_trajectory_without_times_cannot_be_written_as_tum(tmp_path: Path) -> None:
    timeless = files.Trajectory(timestamps=None, world_from_body=some_trajectory().world_from_body)
    with pytest.raises(InputError, match="expected time stamps"):
        files.write_tum(tmp_path / "a.tum", timeless)


@pytest.mark.parametrize("row", [GOOD_TUM, GOOD_KITTI])
def test_limits_hold_for_what_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, row: str
) -> None:
    path = tmp_path / "truth.txt"
    path.write_text(row * 100)
    monkeypatch.setattr(files, "_LARGEST_BYTES", len(row) * 100)
    monkeypatch.setattr(files, "_MOST_POSES", 100)
    monkeypatch.setattr(files, "_BLOCK", 7)
    assert len(files.read_trajectory(path)) == 100
    monkeypatch.setattr(files, "_MOST_POSES", 99)
    with pytest.raises(InputError, match=r"truth\.txt: expected a trajectory of at most 99 poses"):
        files.read_trajectory(path)
    monkeypatch.setattr(files, "_LARGEST_BYTES", len(row) * 100 - 1)
    with pytest.raises(InputError, match=r"truth\.txt: is too large for a trajectory: more than"):
        files.read_trajectory(path)


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="no /proc here")
def test_limits_hold_where_the_size_on_record_is_zero(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "_LARGEST_BYTES", 10)
    with pytest.raises(InputError, match="too large for a trajectory"):
        files.read_trajectory("/proc/self/maps")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_a_pipe_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "truth.tum")
    for read in (files.read_trajectory, files.read_tum, files.read_kitti, files.named_order):
        with pytest.raises(InputError, match="no regular file; expected a trajectory"):
            read(tmp_path / "truth.tum")
