"""positions.csv: every number comes back, as Parquet too; damaged files are named."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
from folder_kit import put

from farpoint.errors import InputError, MissingExtraError
from farpoint.odometry import OdometryResult
from farpoint.sinks import OutputFolder, OutputOptions, RunDescription
from farpoint.sinks.positions import COLUMNS, PositionsFile, read_positions
from farpoint.sinks.trajectory import KittiFile
from farpoint.trajectory.files import read_kitti

MakeResult = Callable[..., OdometryResult]


def with_covariance(result: OdometryResult) -> OdometryResult:
    root = np.random.default_rng(result.frame1).normal(size=(7, 7))
    return replace(result, world_covariance=root @ root.T, segment=result.frame1 // 2)


@pytest.fixture
def results(make_result: MakeResult) -> list[OdometryResult]:
    return [make_result(0), *(with_covariance(make_result(k)) for k in range(1, 5))]


@pytest.fixture
def path(tmp_path: Path, results: list[OdometryResult]) -> Path:
    with PositionsFile(tmp_path / "positions.csv") as file:
        for result in results:
            file.write(result, None)
    return tmp_path / "positions.csv"


def test_every_number_comes_back(path: Path, results: list[OdometryResult]):
    read = read_positions(path)
    np.testing.assert_array_equal(read.timestamps, [r.timestamp for r in results])
    np.testing.assert_array_equal(read.frames, [r.frame1 for r in results])
    np.testing.assert_array_equal(read.segments, [0, 0, 1, 1, 2])
    np.testing.assert_array_equal(read.positions, [r.world_from_cam[:3, 3] for r in results])
    poses = [r.world_from_cam for r in results]
    np.testing.assert_allclose(read.world_from_cam, poses, atol=1e-15)
    assert np.isnan(read.covariances[0]).all()
    for found, result in zip(read.covariances[1:], results[1:], strict=True):
        np.testing.assert_array_equal(np.triu(found), np.triu(result.world_covariance))
        np.testing.assert_array_equal(found, found.T)


def test_a_line_without_its_end_is_left_out(path: Path):
    path.write_text(path.read_text()[:-7])
    assert len(read_positions(path)) == 4


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("timestamp,", "time,", "line 1.*columns of positions.csv"),
        ("\n100.0,", "\nnow,", "line 2.*now"),
        ("\n100.0,", "\n100.0,7,", "line 2.*expected 38 columns, got 39"),
    ],
)
def test_a_damaged_file_is_named(path: Path, before: str, after: str, words: str):
    path.write_text(path.read_text().replace(before, after, 1))
    with pytest.raises(InputError, match=rf"(?s)positions\.csv: {words}"):
        read_positions(path)


def test_kitti_poses_come_back(tmp_path: Path, results: list[OdometryResult]):
    with KittiFile(tmp_path / "trajectory.kitti") as file:
        for result in results:
            file.write(result, None)
    read = read_kitti(tmp_path / "trajectory.kitti")
    np.testing.assert_array_equal(read.world_from_body, [r.world_from_cam for r in results])


QUICK = OutputOptions(overlay=False, report=False, halves_every=0, parquet=True)


@pytest.fixture
def run(camera) -> RunDescription:
    return RunDescription(source="drive.mp4", source_name="drive", camera=camera, options={})


def test_parquet_holds_the_same_numbers(
    tmp_path: Path, run: RunDescription, results: list[OdometryResult], monkeypatch
):
    monkeypatch.setattr("farpoint.sinks.positions._ROWS_AT_ONCE", 2)
    with OutputFolder(tmp_path, run, QUICK) as folder:
        for result in results:
            put(folder, result, None)
    table = pyarrow.parquet.read_table(tmp_path / "positions.parquet")
    assert table.column_names == list(COLUMNS)
    kinds = {name: str(kind) for name, kind in zip(COLUMNS, table.schema.types, strict=True)}
    assert {name for name, kind in kinds.items() if kind == "int64"} == {"frame", "segment"}
    assert set(kinds.values()) == {"int64", "double"}
    read = read_positions(tmp_path / "positions.csv")
    np.testing.assert_array_equal(table["frame"].to_numpy(), read.frames)
    np.testing.assert_array_equal(table["z"].to_numpy(), read.positions[:, 2])
    np.testing.assert_array_equal(table["cov_35"].to_numpy(), read.covariances[:, 3, 5])
    assert table["cov_35"].null_count == 1


def test_parquet_without_its_library_fails_before_the_run(
    tmp_path: Path, run: RunDescription, monkeypatch
):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MissingExtraError, match=r"farpoint\[parquet\]"):
        OutputFolder(tmp_path / "out", run, QUICK)
    assert not (tmp_path / "out").exists()
