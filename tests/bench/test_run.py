from __future__ import annotations

import csv
import json
import math
from datetime import UTC, datetime
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from bench_kit import PEERS, UNSEEDED, absent, silent
from scipy.stats import chi2

from farpoint.bench.options import BenchOptions, CoverageGrid
from farpoint.bench.run import BenchReport, run_bench
from farpoint.bench.scenes import draw_scenes
from farpoint.bench.sequences import Sequence
from farpoint.bench.table import Table
from farpoint.bench.tables import coverage, paper
from farpoint.bench.tables import start as start_module
from farpoint.errors import InputError, MissingExtraError
from farpoint.geometry import so3
from farpoint.pose import estimate_relative_pose
from farpoint.synthetic import cramer_rao_bound

SMALL_GRID = CoverageGrid(baselines_m=(0.0, 0.2), matches=(90,), outlier_shares=(0.2,), trials=12)
SEEDED = BenchOptions(tables=("paper", "accuracy", "coverage"), pairs=2, seed=4, grid=SMALL_GRID)


def run(options: BenchOptions, out: Path) -> BenchReport:
    return run_bench(options, out, silent, show=silent)


def column(table: Table, name: str) -> list:
    index = [c.name for c in table.columns].index(name)
    return [row[index] for row in table.rows]


@pytest.fixture(scope="module")
def seeded(tmp_path_factory: pytest.TempPathFactory) -> tuple[BenchReport, Path]:
    out = tmp_path_factory.mktemp("bench")
    with pytest.MonkeyPatch.context() as monkeypatch:
        absent(monkeypatch, *UNSEEDED)
        return run(SEEDED, out), out


def test_the_report_names_commands_versions_and_peers(seeded: tuple[BenchReport, Path]):
    report, out = seeded
    text = (out / "bench.txt").read_text()
    assert text == report.to_text()
    for table in ("paper", "accuracy"):
        assert f"$ farpoint bench --tables {table} --pairs 2 --seed 4" in text
    assert "farpoint 0." in text
    assert "OpenCV " in text


def test_every_table_is_a_readable_csv(seeded: tuple[BenchReport, Path]):
    report, out = seeded
    names = ["paper", "accuracy", "coverage", "coverage_summary"]
    assert [table.name for table in report.tables] == names
    for table in report.tables:
        with (out / f"{table.name}.csv").open() as file:
            rows = list(csv.reader(file))
        assert rows[0] == [c.name for c in table.columns]
        assert len(rows) == 1 + len(table.rows)
        assert {len(row) for row in rows} == {len(table.columns)}


def test_every_table_is_a_json_with_the_day_and_the_machine(seeded: tuple[BenchReport, Path]):
    report, out = seeded
    assert abs((datetime.now(UTC) - datetime.fromisoformat(f"{report.date}T12Z")).days) <= 1
    for table in report.tables:
        found = json.loads((out / f"{table.name}.json").read_text())
        assert (found["date"], found["environment"]) == (report.date, report.environment)
        assert found["command"] == table.command
        assert len(found["rows"]) == len(table.rows)


def test_the_same_seed_gives_the_same_files(
    seeded: tuple[BenchReport, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    _, out = seeded
    absent(monkeypatch, *UNSEEDED)
    run(SEEDED, tmp_path)
    for file in out.iterdir():
        assert (tmp_path / file.name).read_bytes() == file.read_bytes()


def test_another_seed_gives_other_figures(seeded: tuple[BenchReport, Path], tmp_path: Path):
    _, out = seeded
    run(BenchOptions(tables=("paper",), pairs=2, seed=5), tmp_path)
    assert (tmp_path / "paper.csv").read_bytes() != (out / "paper.csv").read_bytes()


def test_the_paper_table_has_the_published_row_and_a_bound(seeded: tuple[BenchReport, Path]):
    table = seeded[0].tables[0]
    methods = ["Burschka & Mair 2008", "farpoint, closed form", "farpoint", "Cramer-Rao bound"]
    assert column(table, "method") == methods
    assert column(table, "direction_deg")[0] == 2.59
    assert all(0.0 < value < 0.5 for value in column(table, "rotation_x_deg"))


def test_the_bound_of_the_paper_table_is_the_mean_of_gaussian_errors():
    rng = np.random.default_rng(1)
    scene = paper.make_point_scene(paper.paper_protocol(rng), seed=rng)
    draws = rng.multivariate_normal(np.zeros(5), paper.cramer_rao_bound(scene), 40000)
    expected = [
        *np.mean(np.abs(draws[:, :3]), axis=0),
        np.mean(np.linalg.norm(draws[:, 3:], axis=1)),
    ]
    np.testing.assert_allclose(paper._bound_figures([scene]), np.degrees(expected), rtol=0.02)


def test_statuses_of_a_cell_add_up_and_nothing_moves_at_baseline_zero(
    seeded: tuple[BenchReport, Path],
):
    table = seeded[0].tables[2]
    totals = np.sum([column(table, s) for s in ("OK", "ROTATION_ONLY", "STATIC", "FAILED")], axis=0)
    assert totals.tolist() == [12] * 4
    for baseline, share in zip(column(table, "baseline_cm"), column(table, "pose_95"), strict=True):
        assert (share is None) == (baseline == 0.0)
    assert all(
        low <= x <= high
        for low, x, high in zip(
            column(table, "rotation_95_low"),
            column(table, "rotation_95"),
            column(table, "rotation_95_high"),
            strict=True,
        )
    )


def test_a_cell_of_coverage_is_what_its_estimates_say():
    scenes = draw_scenes(
        8, np.random.default_rng(2), baseline_m=0.2, far_share=0.5, matches=90, outliers=9
    )
    figures = coverage._figures(scenes, 0)
    squared = []
    for scene in scenes:
        pose = estimate_relative_pose(scene.points0, scene.points1, scene.camera)
        assert pose.rotation_cam1_from_cam0 is not None
        dtheta = so3.log(scene.rotation_cam1_from_cam0 @ pose.rotation_cam1_from_cam0.T)
        squared.append(dtheta @ np.linalg.solve(pose.rotation_covariance, dtheta))
    names = [column.name for column in coverage._COLUMNS[5:]]
    cell = dict(zip(names, figures, strict=True))
    assert cell["rotation_nees"] == pytest.approx(np.mean(squared))
    assert cell["rotation_68"] == np.mean(np.array(squared) < chi2.ppf(0.68, 3))
    assert cell["pose_95"] is not None
    assert (cell["observable"], cell["observable_OK"]) == (8, 8)


def test_what_hardly_shows_is_not_observable():
    """Some of these motions have a bound below 5 degrees, none of those at rest."""
    cells = {}
    for baseline_m in (0.0, 0.02):
        scenes = draw_scenes(
            12,
            np.random.default_rng(2),
            baseline_m=baseline_m,
            far_share=0.5,
            matches=90,
            outliers=0,
            noise_px=1.0,
        )
        names = [column.name for column in coverage._COLUMNS[5:]]
        cells[baseline_m] = dict(zip(names, coverage._figures(scenes, 0), strict=True))
    assert (cells[0.0]["observable"], cells[0.0]["observable_OK"]) == (0, 0)
    bounds = [np.linalg.eigvalsh(cramer_rao_bound(s)[3:, 3:])[-1] ** 0.5 for s in scenes]
    below = int(np.sum(np.degrees(bounds) < 5.0))
    assert 0 < below < 12
    assert cells[0.02]["observable"] == below
    assert cells[0.02]["observable_OK"] <= min(below, cells[0.02]["OK"])


def test_an_interruption_leaves_what_was_found(tmp_path: Path):
    def interrupt(what: str, done: int, _: int) -> None:
        if what == "coverage" and done == 1:
            raise KeyboardInterrupt

    shown = []
    with pytest.raises(KeyboardInterrupt):
        run_bench(
            BenchOptions(tables=("paper", "coverage"), pairs=1, grid=SMALL_GRID),
            tmp_path,
            interrupt,
            show=shown.append,
        )
    tables = ("coverage", "coverage_summary", "paper")
    files = {f"{name}.{kind}" for name in tables for kind in ("csv", "json")}
    assert {f.name for f in tmp_path.iterdir()} == {"bench.txt", *files}
    cells = (tmp_path / "coverage.csv").read_text().splitlines()
    assert [cell.split(",")[0] for cell in cells] == ["baseline_cm", "0"]
    found = (tmp_path / "bench.txt").read_text()
    assert found.startswith("\n".join(shown))
    assert "Coverage: share of" in found


def test_without_peers_farpoint_is_measured_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    absent(monkeypatch, *PEERS)
    report = run(BenchOptions(tables=("accuracy", "pairs"), pairs=1), tmp_path)
    assert "absent: PoseLib, pycolmap, OpenCV" in report.environment
    assert set(column(report.tables[0], "estimator")) == {"farpoint"}
    assert report.skipped == ("pairs: skipped, --data names no files of matches (.npz)",)
    assert report.skipped[0] in (tmp_path / "bench.txt").read_text()


def test_a_missing_library_skips_its_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def refuse(*_: object, **__: object) -> None:
        raise MissingExtraError("the plain OpenCV script needs cv2")

    monkeypatch.setattr("farpoint.bench.plain_script.optional_import", refuse)
    monkeypatch.setattr(Sequence, "images", lambda *_: [np.zeros((375, 1242), np.uint8)] * 10)
    report = run(BenchOptions(tables=("pipeline",)), tmp_path)
    assert report.skipped == ("pipeline: skipped, the plain OpenCV script needs cv2",)


def test_times_are_positive_and_the_chart_is_xml(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    absent(monkeypatch, "poselib", "pycolmap", *UNSEEDED)
    monkeypatch.setattr("farpoint.bench.tables.start._start", lambda _: (0.5, 1.5))
    report = run(BenchOptions(tables=("time",), pairs=1), tmp_path)
    time, matches, outliers, baselines, start = report.tables
    assert [column(time, "time_over_farpoint")[row] for row in (0, 4)] == [1.0, 1.0]
    assert all(value > 0.0 for value in column(time, "median_ms"))
    assert column(matches, "matches") == [8, 20, 50, 110, 300, 500, 1000, 2000, 5000]
    assert column(outliers, "outliers_percent") == [0, 10, 20, 30, 40, 50, 60]
    assert column(baselines, "baseline_cm") == [20.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.0]
    ms = column(matches, "farpoint_ms")
    assert f"take {ms[8] / ms[5]:.1f} times" in matches.notes[0]
    assert column(start, "total_s") == [2.0, 2.0]
    for name in ("time_matches", "time_outliers", "time_baselines"):
        ElementTree.parse(tmp_path / f"{name}.svg")


def test_a_fresh_process_tells_its_own_times(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    # Uncompiled, so that the test does not wait for the compiler.
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    imported_s, estimated_s = start_module._start(str(tmp_path))
    assert 0.0 < imported_s < 60.0
    assert 0.0 < estimated_s < 60.0
    assert math.isfinite(imported_s + estimated_s)


@pytest.mark.parametrize("option", ["data", "out"])
def test_paths_of_no_use_are_named(tmp_path: Path, option: str):
    file = tmp_path / "file"
    file.write_text("")
    data = (tmp_path / "nowhere",) if option == "data" else ()
    out = file if option == "out" else tmp_path / "out"
    with pytest.raises(InputError) as caught:
        run(BenchOptions(tables=("pairs",), data=data), out)
    assert str(tmp_path) in str(caught.value)
    assert "\n" not in str(caught.value)
