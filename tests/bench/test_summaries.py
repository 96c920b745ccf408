"""Tables of many rows in few."""

from __future__ import annotations

import math
from typing import Any

import pytest

from farpoint.bench.accuracy import REAL_COLUMNS
from farpoint.bench.consistency import CONSISTENCY_COLUMNS
from farpoint.bench.table import Cell, Column, Table
from farpoint.bench.tables import coverage
from farpoint.bench.tables.coverage_summary import coverage_summary
from farpoint.bench.tables.steps_summary import steps_summary

CASE = tuple(map(Column, ("sequence", "kind", "step", "pairs", "matches", "estimator")))


def table_of(columns: tuple[Column, ...], rows: list[dict[str, Any]]) -> Table:
    cells: tuple[tuple[Cell, ...], ...] = tuple(
        tuple(row.get(column.name) for column in columns) for row in rows
    )
    return Table(name="t", title="", command="farpoint bench", columns=columns, rows=cells)


def rows_of(table: Table) -> list[dict[str, Any]]:
    names = [column.name for column in table.columns]
    return [dict(zip(names, row, strict=True)) for row in table.rows]


def cell(baseline_cm: float, far_percent: int, **figures: Any) -> dict[str, Any]:
    statuses = {"OK": 0, "ROTATION_ONLY": 0, "STATIC": 0, "FAILED": 0}
    counts = {"observable": 0, "observable_OK": 0}
    place = {"baseline_cm": baseline_cm, "far_percent": far_percent, "noise_px": 0.22}
    return {**place, "outliers_percent": 0, "matches": 90, **statuses, **counts, **figures}


def test_cells_of_a_kind_weigh_by_their_estimates():
    shares = {"rotation_68": 0.7, "rotation_95": 0.9}
    cells = [
        cell(2.0, 0, OK=100, pose_68=0.6, pose_95=0.9, observable=90, observable_OK=80, **shares),
        cell(20.0, 50, OK=50, FAILED=50, pose_68=0.9, pose_95=0.96, **shares),
        cell(20.0, 50, OK=10, ROTATION_ONLY=90, pose_68=0.5, pose_95=0.5, **shares),
        cell(0.0, 100, OK=1, ROTATION_ONLY=99, **shares),
        cell(2.0, 100, ROTATION_ONLY=100, **{**shares, "rotation_95": 0.2}),
    ]
    assert {column.name for column in CONSISTENCY_COLUMNS} > {"pose_68", "rotation_95"}
    far, near, turned = rows_of(coverage_summary(table_of(coverage._COLUMNS, cells)))
    assert [row["scenes"] for row in (far, near, turned)] == [
        "far points only",
        "near points",
        "rotation only",
    ]
    assert (near["cells"], near["pairs"], near["OK"]) == (3, 300, 160)
    assert (near["observable"], near["observable_OK"]) == (90, 80)
    assert near["pose_95"] == pytest.approx((100 * 0.9 + 50 * 0.96 + 10 * 0.5) / 160)
    assert near["pose_95_lowest"] == 0.9  # the cell of ten does not count
    assert near["rotation_95"] == pytest.approx(0.9)
    assert (turned["OK"], turned["pose_95"], turned["pose_95_lowest"]) == (1, None, None)
    assert far["rotation_95_lowest"] == 0.2


def case(sequence: str, step: int, **peer: Any) -> list[dict[str, Any]]:
    place = {"sequence": sequence, "kind": "SIFT", "step": step}
    ours = {"rotation_over_farpoint": 1.0, "rotation_over_low": 1.0, "rotation_over_high": 1.0}
    return [
        {**place, "estimator": "farpoint", "direction_mean_deg": 1.0, "gross": 1, **ours},
        {**place, "estimator": "a peer", "gross": 2, **peer},
    ]


def test_ratios_of_steps_are_geometric_means_below_1_where_farpoint_is_better():
    better = {
        "rotation_over_farpoint": 4.0,
        "rotation_over_low": 2.0,
        "rotation_over_high": 8.0,
        "direction_mean_deg": 2.0,
    }
    worse = {
        "rotation_over_farpoint": 0.25,
        "rotation_over_low": 0.1,
        "rotation_over_high": 0.9,
        "direction_mean_deg": math.nan,
    }
    steps = [*case("a", 1, **better), *case("a", 2, **worse), *case("b", 1, **better)]
    found = rows_of(steps_summary(table_of((*CASE, *REAL_COLUMNS), steps)))
    assert [(row["sequence"], row["peer"], row["cases"]) for row in found] == [
        ("a", "a peer", 2),
        ("b", "a peer", 1),
        ("all together", "a peer", 3),
    ]
    a, b, together = found
    assert a["rotation_ratio"] == pytest.approx(1.0)
    assert b["rotation_ratio"] == pytest.approx(0.25)
    assert together["rotation_ratio"] == pytest.approx(4.0 ** (-1 / 3))
    assert together["direction_ratio"] == pytest.approx(0.5)
    assert [(row["better"], row["worse"]) for row in found] == [(1, 1), (1, 0), (2, 1)]
    assert (together["gross"], together["gross_of_peer"]) == (3, 6)
