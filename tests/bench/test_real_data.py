from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench_kit import silent

from farpoint.bench.options import BenchOptions
from farpoint.bench.plain_script import PlainScript
from farpoint.bench.run import run_bench
from farpoint.bench.sequences import find_sequences, rendered_sequence
from farpoint.bench.table import Table
from farpoint.camera import Camera
from farpoint.geometry import so3, sphere
from farpoint.synthetic.sequence import render_drive

SMALL = Camera.pinhole(400, 200, 240.0, 240.0, 199.5, 99.5)


def run(options: BenchOptions, out: Path) -> Table:
    (table,) = run_bench(options, out, silent, show=silent).tables
    return table


def test_real_pairs_against_the_peers(shared_data: Path, tmp_path: Path):
    file = shared_data / "pairs" / "kitti_a.npz"
    table = run(BenchOptions(tables=("pairs",), data=(file,), pairs=4), tmp_path)
    names = [column.name for column in table.columns]
    rows = [dict(zip(names, row, strict=True)) for row in table.rows]
    assert rows[0]["estimator"] == "farpoint"
    assert {row["data"] for row in rows} == {"kitti_a"}
    assert {row["pairs"] for row in rows} == {4}
    assert rows[0]["rotation_median_deg"] < 0.1
    assert rows[0]["direction_median_deg"] < 2.0
    assert all(row["median_ms"] > 0.0 for row in rows)


def test_sequences_are_found_with_their_cameras(shared_data: Path):
    found = {sequence.name: sequence for sequence in find_sequences((shared_data,))}
    assert {"kitti_a", "kitti_00", "euroc_v101_micro", "hololens"} <= set(found)
    assert not {"pairs", "calibrations", "trajectories", "kimera_fisheye_pair"} & set(found)
    images = found["kitti_a"].images(2)
    assert [image.shape for image in images] == [(370, 1226)] * 2
    alone = find_sequences((shared_data / "kitti_a",))
    assert [sequence.name for sequence in alone] == ["kitti_a"]


def test_the_plain_script_finds_the_motion_of_a_rendered_drive():
    pytest.importorskip("cv2")
    drive = render_drive(SMALL, frames=4, seed=1)
    script = PlainScript(SMALL, 500)
    motions = [script.process(frame.image) for frame in drive]
    assert motions[0] is None
    for index, motion in enumerate(motions[1:]):
        assert motion is not None
        truth = drive.cam1_from_cam0(index, index + 1)
        assert np.degrees(so3.angle_between(motion[0], truth[:3, :3])) < 0.5
        direction = sphere.normalize(truth[:3, 3])
        assert np.degrees(sphere.angle_between(motion[1], direction)) < 15.0


def test_the_pipeline_table_times_both(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    pytest.importorskip("cv2")
    drive = replace(rendered_sequence(0), camera=SMALL)
    monkeypatch.setattr("farpoint.bench.tables.pipeline.rendered_sequence", lambda _seed: drive)
    table = run(BenchOptions(tables=("pipeline",), pairs=8), tmp_path)
    row = dict(zip([column.name for column in table.columns], table.rows[0], strict=True))
    assert row["sequence"] == "rendered drive"
    assert row["frames"] == 9
    assert row["decode_ms"] is None
    ours_ms, theirs_ms = 1e3 / row["farpoint_fps"], row["opencv_script_ms"]
    assert row["farpoint_tracks_ms"] + row["farpoint_pose_ms"] <= 1.5 * ours_ms
    assert row["time_ratio"] == pytest.approx(theirs_ms / ours_ms)
