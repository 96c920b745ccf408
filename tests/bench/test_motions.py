"""The table of odometry over rendered streets, and how its pairs are judged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bench_kit import silent

from farpoint.bench.options import BenchOptions
from farpoint.bench.rendered import RENDERED_COLUMNS, rendered_cells, run_rendered
from farpoint.bench.sequences import find_trajectories
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
    write_tum(tmp_path / "flight.txt", Trajectory(timestamps=times, world_from_body=poses))
    (tmp_path / "README.txt").write_text("Where this is from.\n")
    (tmp_path / "numbers.txt").write_text("1 2 3\n")
    return tmp_path


def test_motions_are_found_among_other_files(data: Path):
    assert list(find_trajectories((data,))) == ["flight"]
    assert list(find_trajectories((data.parent,))) == ["flight"]
    assert list(find_trajectories((data / "flight.txt",))) == ["flight"]
    assert find_trajectories((data / "README.txt",)) == {}


def test_each_motion_and_lens_has_a_row(data: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(motions, "_LENSES", {"small": CAMERA})
    monkeypatch.setattr(motions, "_PAIRS_PER_STREET", 2)
    options = BenchOptions(tables=("motions",), pairs=3, data=(data,))
    first, *_, table = motions.motions_table(options, silent)
    assert len(first.rows) == 1
    names = [column.name for column in table.columns]
    rows = [dict(zip(names, row, strict=True)) for row in table.rows]
    assert [row["motion"] for row in rows] == ["drive, 10 fps", "drive, 30 fps", "flight"]
    for row in rows:
        assert (row["lens"], row["streets"], row["pairs"], row["OK"]) == ("small", 2, 4, 4)
        assert row["rotation_median_deg"] < 0.1
        assert row["direction_over_bound"] < 5.0


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
