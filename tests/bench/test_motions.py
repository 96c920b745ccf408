"""The table of odometry over rendered streets, and how its pairs are judged."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench_kit import silent

from farpoint.bench.options import BenchOptions
from farpoint.bench.rendered import (
    RENDERED_COLUMNS,
    RenderedErrors,
    rendered_cells,
    run_rendered,
)
from farpoint.bench.sequences import find_trajectories
from farpoint.bench.table import Table
from farpoint.bench.tables import motions
from farpoint.camera import Camera
from farpoint.pose import PoseStatus
from farpoint.synthetic import RenderedSequence
from farpoint.trajectory.files import Trajectory, write_tum

CAMERA = Camera.pinhole(320, 200, 200.0, 200.0, 159.5, 99.5)


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """A folder with a motion, and with other texts."""
    times = np.arange(0.0, 6.0, 0.02)
    poses = np.tile(np.eye(4), (len(times), 1, 1))
    poses[:, :3, 3] = np.outer(times, [0.6, 0.1, 0.2])
    write_tum(tmp_path / "flight_1.txt", Trajectory(timestamps=times, world_from_body=poses))
    (tmp_path / "README.txt").write_text("Where this is from.\n")
    (tmp_path / "numbers.txt").write_text("1 2 3\n")
    return tmp_path


def test_motions_are_found_among_other_files(data: Path):
    assert list(find_trajectories((data,))) == ["flight_1"]
    assert list(find_trajectories((data.parent,))) == ["flight_1"]
    assert list(find_trajectories((data / "flight_1.txt",))) == ["flight_1"]
    assert find_trajectories((data / "README.txt",)) == {}


def rows_of(table: Table) -> list[dict[str, Any]]:
    names = [column.name for column in table.columns]
    return [dict(zip(names, row, strict=True)) for row in table.rows]


def test_each_motion_and_lens_has_a_row(data: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(motions, "_LENSES", {"small": CAMERA})
    monkeypatch.setattr(motions, "_PAIRS_PER_STREET", 2)
    options = BenchOptions(tables=("motions",), pairs=3, data=(data,))
    first, *_, table, summary = motions.motions_table(options, silent)
    assert len(first.rows) == 1
    rows = rows_of(table)
    assert [row["motion"] for row in rows] == ["drive, 10 fps", "drive, 30 fps", "flight_1"]
    for row in rows:
        assert (row["lens"], row["streets"], row["pairs"], row["OK"]) == ("small", 2, 4, 4)
        assert row["rotation_median_deg"] < 0.1
        assert row["direction_over_bound"] < 5.0
    kinds = [(row["motion"], row["fps"]) for row in rows_of(summary)]
    assert kinds == [("drive", 10), ("drive", 30), ("flight", 20)]
    for row, whole in zip(rows_of(summary), rows, strict=True):
        shared = set(row) & set(whole) - {"motion"}
        assert {name: row[name] for name in shared} == {name: whole[name] for name in shared}
        assert {"streets", "pairs", "pose_95", "rotation_95", "direction_95"} < shared
    assert summary.command == table.command


def errors_of(*squares: tuple[float, float, float]) -> RenderedErrors:
    """Pairs by the normalised squares of pose, rotation and direction; NaN: no direction."""
    pose, rotation, direction = np.array(squares).T
    empty = np.full(len(squares), np.nan)
    return RenderedErrors(
        statuses=tuple(
            PoseStatus.ROTATION_ONLY if np.isnan(square) else PoseStatus.OK for square in pose
        ),
        rotation_deg=rotation,
        direction_deg=direction,
        rotation_nees=rotation,
        direction_nees=direction,
        pose_nees=pose,
        rotation_over_bound=empty,
        direction_over_bound=empty,
        tracks=empty,
    )


def test_recordings_of_a_kind_weigh_by_their_pairs():
    def motion(kind: str, fps: float, errors: RenderedErrors) -> motions.MotionErrors:
        return motions.MotionErrors(kind=kind, fps=fps, lens="small", streets=2, errors=errors)

    right, wrong, turned = (1.0, 1.0, 1.0), (99.0, 99.0, 1.0), (np.nan, 1.0, np.nan)
    summary = motions.motions_summary(
        [
            motion("room", 20.0, errors_of(right, right, right)),
            motion("drive", 20.0, errors_of(right)),
            motion("room", 20.0, errors_of(wrong, turned)),
            motion("room", 30.0, errors_of(wrong)),
        ],
        "farpoint bench",
    )
    together, drive, fast = rows_of(summary)
    assert (together["motion"], together["fps"], together["streets"]) == ("room", 20, 4)
    assert (together["pairs"], together["OK"]) == (5, 4)
    assert (together["pose_95"], together["rotation_95"]) == (0.75, 0.8)
    assert together["direction_95"] == 1.0
    assert (drive["pairs"], drive["pose_95"], fast["pose_95"]) == (1, 1.0, 0.0)


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("dataset-room1_512_16", "dataset-room"),
        ("dataset-room2_512_16", "dataset-room"),
        ("indoor_forward_5_snapdragon", "indoor_forward"),
        ("flight", "flight"),
        ("20260101", "20260101"),
    ],
)
def test_names_of_recordings_name_their_kind(name: str, kind: str):
    assert motions._kind(name) == kind


def test_parts_of_a_motion_differ_by_seed_and_leave_gaps_out(data: Path):
    (body,) = find_trajectories((data,)).values()
    starts = [[p.timestamps[0] for p in motions._parts(body, 4, 11, seed)] for seed in (0, 1)]
    assert starts[0] != starts[1]
    for start_s in starts:
        assert all(
            k / 4 <= s / (6.0 - 0.02 - 11 / 20) <= (k + 1) / 4 for k, s in enumerate(start_s)
        )
    known = (body.timestamps < 2.0) | (body.timestamps > 4.0)
    lost = Trajectory(
        timestamps=body.timestamps[known], world_from_body=body.world_from_body[known]
    )
    assert 0 < len(motions._parts(lost, 4, 11, 0)) < 4
    assert motions._parts(body, 2, 500, 0) == []


def test_a_rotation_alone_counts_as_one():
    # A millimetre a frame, 300 m above the street: nothing is near.
    poses = np.tile(np.eye(4), (4, 1, 1))
    poses[:, :3, 3] = [[0.0, -300.0, 0.001 * k] for k in range(4)]
    down = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    poses[:, :3, :3] = down
    path = Trajectory(timestamps=0.1 * np.arange(4), world_from_body=poses)
    errors = run_rendered(RenderedSequence(CAMERA, path, seed=3))
    assert PoseStatus.OK not in errors.statuses
    assert PoseStatus.FAILED not in errors.statuses
    assert np.isfinite(errors.rotation_nees).all()
    assert np.isnan(errors.pose_nees).all()
    row = dict(zip((c.name for c in RENDERED_COLUMNS), rendered_cells(errors), strict=True))
    assert (row["pairs"], row["OK"]) == (3, 0)
    assert row["rotation_95"] is not None
    assert row["direction_95"] is row["pose_95"] is row["rotation_median_deg"] is None
