"""The table of hard scenes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from bench_kit import estimator_of, silent, some_views

from farpoint.bench.estimators import FARPOINT, Motion
from farpoint.bench.options import BenchOptions
from farpoint.bench.table import Cell, Table
from farpoint.bench.tables import scenes
from farpoint.bench.views import TwoViews
from farpoint.geometry import sphere
from farpoint.pose import RelativePose, estimate_relative_pose
from farpoint.synthetic.pairs import KINDS

EASY, TURN, JUNK = "traffic, 20 % by 3 px", "turn, half of the matches wrong", "wrong matches alone"


def truth(views: TwoViews) -> Motion:
    """The true motion; for a turn, any direction."""
    t = views.translation_cam1_from_cam0
    direction = sphere.normalize(t) if t.any() else np.array([1.0, 0.0, 0.0])
    return Motion(views.rotation_cam1_from_cam0, direction)


def made(monkeypatch: pytest.MonkeyPatch, *kinds: str, pairs: int = 3, seed: int = 0) -> Table:
    monkeypatch.setattr(scenes, "KINDS", {kind: KINDS[kind] for kind in kinds})
    estimators = (FARPOINT, estimator_of("truth", truth))
    monkeypatch.setattr(scenes, "all_estimators", lambda: estimators)
    options = BenchOptions(tables=("scenes",), pairs=pairs, seed=seed)
    *_, table = scenes.scenes_table(options, silent)
    return table


def rows(table: Table) -> list[dict[str, Cell]]:
    return [dict(zip((c.name for c in table.columns), row, strict=True)) for row in table.rows]


def turned_around(pose: RelativePose) -> RelativePose:
    assert pose.direction_cam1_from_cam0 is not None
    return replace(pose, direction_cam1_from_cam0=-pose.direction_cam1_from_cam0)


def with_sigma(pose: RelativePose, *sigmas_deg: float) -> RelativePose:
    """The pose with these sigmas of its direction."""
    assert pose.covariance is not None
    covariance = pose.covariance.copy()
    covariance[3:, :3] = covariance[:3, 3:] = 0.0
    covariance[3:, 3:] = np.diag(np.radians(sigmas_deg) ** 2)
    return replace(pose, covariance=covariance)


def estimated(views: TwoViews) -> RelativePose:
    return estimate_relative_pose(views.points0, views.points1, views.camera, seed=0)


def test_a_kind_has_a_row_for_each_estimator(monkeypatch: pytest.MonkeyPatch):
    table = made(monkeypatch, EASY)
    own, peer = rows(table)
    assert (own["scene"], own["estimator"], peer["estimator"]) == (EASY, "farpoint", "truth")
    assert 0.0 < own["rotation_median_deg"] < 0.1
    assert 0.0 < own["direction_median_deg"] < 5.0
    assert (own["failed"], own["no_direction"], own["gross"], own["sure_wrong"]) == (0, 0, 0, 0)
    for figure in ("rotation_95", "pose_95"):
        assert own[f"{figure}_low"] < own[figure] <= own[f"{figure}_high"]
    assert (peer["rotation_mean_deg"], peer["gross"]) == (pytest.approx(0.0, abs=1e-4), 0)
    names = [column.name for column in table.columns]
    assert [peer[name] for name in names[names.index("sure_wrong") :]] == [None] * 7
    assert "--tables scenes --pairs 3" in table.command
    assert "3 pairs a scene" in table.to_text()


def test_the_table_is_given_after_every_kind(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(scenes, "KINDS", {kind: KINDS[kind] for kind in (EASY, TURN)})
    monkeypatch.setattr(scenes, "all_estimators", lambda: (FARPOINT,))
    tables = scenes.scenes_table(BenchOptions(tables=("scenes",), pairs=1), silent)
    assert [[row["scene"] for row in rows(table)] for table in tables] == [[EASY], [EASY, TURN]]


def test_a_turn_has_no_errors_of_the_direction(monkeypatch: pytest.MonkeyPatch):
    own, peer = rows(made(monkeypatch, TURN))
    assert own["no_direction"] == 3
    assert own["rotation_median_deg"] < 0.1
    assert np.isnan(own["direction_median_deg"])
    assert np.isnan(peer["direction_median_deg"])
    assert (own["sure_wrong"], own["gross"], peer["gross"]) == (0, 0, 0)
    assert own["rotation_95"] is not None
    assert own["pose_95"] is None


def test_wrong_matches_alone_have_no_regions(monkeypatch: pytest.MonkeyPatch):
    own, _ = rows(made(monkeypatch, JUNK))
    assert own["failed"] == 3
    assert own["sure_wrong"] == 0
    assert own["rotation_95"] is own["pose_95"] is None


def test_the_same_seed_gives_the_same_figures_and_another_one_does_not(
    monkeypatch: pytest.MonkeyPatch,
):
    first, again, other = (made(monkeypatch, EASY, seed=seed).to_csv() for seed in (1, 1, 2))
    assert first == again
    assert first != other


@pytest.mark.parametrize(
    ("change", "count"),
    [
        (lambda pose: with_sigma(pose, 1.0, 9.0), 0),
        (lambda pose: with_sigma(turned_around(pose), 1.0, 9.0), 2),
        (lambda pose: with_sigma(turned_around(pose), 1.0, 11.0), 0),
        (lambda pose: replace(pose, direction_cam1_from_cam0=None, covariance=None), 0),
    ],
    ids=["right", "wrong and sure", "wrong and unsure", "no direction"],
)
def test_wrong_directions_with_small_sigmas_are_counted(
    change: Callable[[RelativePose], RelativePose], count: int
):
    views = some_views(2)
    poses = [change(estimated(each)) for each in views]
    assert scenes.count_sure_and_wrong(poses, views) == count


@pytest.mark.parametrize(("sigma_deg", "count"), [(9.0, 1), (11.0, 0)])
def test_any_sure_direction_of_a_camera_at_rest_is_counted(sigma_deg: float, count: int):
    (views,) = some_views(1)
    at_rest = replace(views, translation_cam1_from_cam0=np.zeros(3))
    pose = with_sigma(estimated(views), sigma_deg, sigma_deg)
    assert scenes.count_sure_and_wrong([pose], [at_rest]) == count


@pytest.mark.parametrize("off_deg", [20.0, 40.0])
def test_a_direction_is_wrong_from_30_degrees_on(off_deg: float):
    (views,) = some_views(1)
    true, aside = truth(views).direction_cam1_from_cam0, np.random.default_rng(0).normal(size=3)
    assert true is not None
    across = sphere.normalize(np.cross(true, aside))
    angle = np.radians(off_deg)
    direction = np.cos(angle) * true + np.sin(angle) * across
    pose = with_sigma(replace(estimated(views), direction_cam1_from_cam0=direction), 5.0, 5.0)
    assert scenes.count_sure_and_wrong([pose], [views]) == (off_deg > 30.0)


def test_the_table_shows_wrong_directions_and_regions(monkeypatch: pytest.MonkeyPatch):
    def backwards(*args: object, **options: object) -> RelativePose:
        return turned_around(estimate_relative_pose(*args, **options))

    monkeypatch.setattr(scenes, "estimate_relative_pose", backwards)
    own, _ = rows(made(monkeypatch, EASY))
    assert own["sure_wrong"] == 3
    assert own["pose_95"] == 0.0
