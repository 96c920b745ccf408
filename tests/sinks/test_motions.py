"""motions.csv: what is written reads back to the same bits; damage is named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from farpoint.errors import InputError
from farpoint.odometry import OdometryResult
from farpoint.pose import PoseStatus
from farpoint.sinks.motions import COLUMNS, MotionsFile, iter_motions, read_motions

MakeResult = Callable[..., OdometryResult]

HEADER = (
    "timestamp0,timestamp1,frame0,frame1,status,qx,qy,qz,qw,dx,dy,dz,scale,scale_sigma,"
    "tracks,far,near,outliers,noise_px,"
    "cov_00,cov_01,cov_02,cov_03,cov_04,cov_11,cov_12,cov_13,cov_14,cov_22,cov_23,cov_24,"
    "cov_33,cov_34,cov_44"
)


def write_all(path: Path, results: list[OdometryResult]) -> None:
    with MotionsFile(path) as file:
        for result in results:
            file.write(result, None)


def every_status(make_result: MakeResult) -> list[OdometryResult]:
    return [make_result(0), *(make_result(k + 1, status) for k, status in enumerate(PoseStatus))]


def test_the_header_is_the_published_one(tmp_path: Path) -> None:
    write_all(tmp_path / "motions.csv", [])
    assert (tmp_path / "motions.csv").read_text() == HEADER + "\n"
    assert len(read_motions(tmp_path / "motions.csv")) == 0


def test_numbers_read_back_to_the_same_bits(tmp_path: Path, make_result: MakeResult) -> None:
    results = [make_result(k) for k in range(12)]
    write_all(tmp_path / "motions.csv", results)
    motions = read_motions(tmp_path / "motions.csv")
    poses = [result.pose for result in results[1:]]
    assert len(motions) == len(poses)
    for row, pose in enumerate(poses):
        assert pose is not None
        np.testing.assert_array_equal(motions.covariance[row], pose.covariance)
        np.testing.assert_array_equal(
            motions.direction_cam1_from_cam0[row], pose.direction_cam1_from_cam0
        )
        np.testing.assert_array_equal(motions.direction_basis[row], pose.direction_basis)
        np.testing.assert_allclose(
            motions.rotation_cam1_from_cam0[row], pose.rotation_cam1_from_cam0, atol=1e-15
        )
        assert motions.noise_px[row] == pose.noise_px
        assert motions.near[row] == pose.stats.near
    np.testing.assert_array_equal(motions.timestamp1, [r.timestamp for r in results[1:]])


def test_each_status_leaves_empty_what_it_cannot_know(
    tmp_path: Path, make_result: MakeResult
) -> None:
    path = tmp_path / "motions.csv"
    write_all(path, every_status(make_result))
    rows = [
        dict(zip(COLUMNS, line.split(","), strict=True)) for line in path.read_text().splitlines()
    ][1:]
    filled = {row["status"]: {name for name in COLUMNS if row[name]} for row in rows}
    always = {"timestamp0", "timestamp1", "frame0", "frame1", "status"}
    always |= {"tracks", "far", "near", "outliers"}
    turn = {"qx", "qy", "qz", "qw", "noise_px"}
    turn |= {f"cov_{name}" for name in ("00", "01", "02", "11", "12", "22")}
    assert filled["FAILED"] == always
    assert filled["STATIC"] == filled["ROTATION_ONLY"] == always | turn
    assert filled["OK"] == set(COLUMNS) - {"scale_sigma"}

    motions = read_motions(path)
    assert list(motions.status) == list(PoseStatus)
    known = np.isfinite(motions.rotation_cam1_from_cam0[:, 0, 0])
    np.testing.assert_array_equal(known, motions.status != PoseStatus.FAILED)
    np.testing.assert_array_equal(
        np.isfinite(motions.covariance).all((1, 2)), motions.status == PoseStatus.OK
    )
    np.testing.assert_array_equal(np.isfinite(motions.rotation_covariance).all((1, 2)), known)


def test_covariance_is_in_a_basis_that_a_reader_can_compute(
    tmp_path: Path, make_result: MakeResult
) -> None:
    result = make_result(3)
    pose = result.pose
    assert pose is not None
    assert pose.direction_basis is not None
    assert pose.covariance is not None
    turned = pose.direction_basis @ np.array([[0.6, -0.8], [0.8, 0.6]])
    other = replace(result, pose=replace(pose, direction_basis=turned))
    write_all(tmp_path / "motions.csv", [other])
    motions = read_motions(tmp_path / "motions.csv")
    in_space_written = turned @ pose.covariance[3:, 3:] @ turned.T
    basis = motions.direction_basis[0]
    in_space_read = basis @ motions.covariance[0, 3:, 3:] @ basis.T
    np.testing.assert_allclose(in_space_read, in_space_written, rtol=1e-12, atol=1e-18)


def test_every_row_is_in_the_file_before_the_next(tmp_path: Path, make_result: MakeResult) -> None:
    path = tmp_path / "motions.csv"
    file = MotionsFile(path)
    for count in range(1, 4):
        file.write(make_result(count), None)
        assert len(read_motions(path)) == count
    file.close()
    file.close()


def test_a_row_that_was_being_written_is_left_out(tmp_path: Path, make_result: MakeResult) -> None:
    path = tmp_path / "motions.csv"
    write_all(path, [make_result(k) for k in range(5)])
    path.write_text(path.read_text()[:-3])
    assert len(read_motions(path)) == 3


def test_parts_are_the_whole(tmp_path: Path, make_result: MakeResult) -> None:
    path = tmp_path / "motions.csv"
    write_all(path, [make_result(k) for k in range(8)])
    parts = list(iter_motions(path, chunk_rows=3))
    assert [len(part) for part in parts] == [3, 3, 1]
    np.testing.assert_array_equal(
        np.concatenate([part.covariance for part in parts]), read_motions(path).covariance
    )


def change(column: str, cell: str) -> Callable[[list[str]], list[str]]:
    index = COLUMNS.index(column)
    return lambda cells: [*cells[:index], cell, *cells[index + 1 :]]


DAMAGED = {
    "a word": (change("qx", "west"), "line 3, column qx: expected a number, got 'west'"),
    "a gap": (change("cov_34", ""), "line 3, column cov_34: expected a number where"),
    "not finite": (change("noise_px", "nan"), "line 3, column noise_px: expected a finite"),
    "a strange status": (change("status", "GREAT"), "line 3, column status: expected one of OK"),
    "a short row": (lambda cells: cells[:9], "line 3: expected 34 columns, got 9"),
    "no unit quaternion": (change("qw", "3.0"), "line 3, column qx..qw: expected a unit"),
    "no unit direction": (change("dz", "0.1"), "line 3, column dx..dz: expected a unit"),
}


@pytest.mark.parametrize("damage", DAMAGED)
def test_damage_names_file_line_and_column(
    tmp_path: Path, make_result: MakeResult, damage: str
) -> None:
    path = tmp_path / "motions.csv"
    write_all(path, [make_result(k) for k in range(5)])
    alter, message = DAMAGED[damage]
    lines = path.read_text().splitlines()
    lines[2] = ",".join(alter(lines[2].split(",")))
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError) as caught:
        read_motions(path)
    assert str(caught.value).startswith(f"{path}: {message}")


def test_foreign_and_missing_files_are_named(tmp_path: Path) -> None:
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match=r"other\.csv: line 1: expected the columns of motions"):
        read_motions(tmp_path / "other.csv")
    with pytest.raises(InputError, match=r"none\.csv: cannot be read: No such file"):
        read_motions(tmp_path / "none.csv")
    (tmp_path / "picture.csv").write_bytes(b"\xff\xd8\xff")
    with pytest.raises(InputError, match="expected a text file"):
        read_motions(tmp_path / "picture.csv")


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"gone/motions\.csv: cannot be written"):
        MotionsFile(tmp_path / "gone" / "motions.csv")
