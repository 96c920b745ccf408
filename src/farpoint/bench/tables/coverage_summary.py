"""Summary of the table of coverage, in which a row stands for all cells of a kind of scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from farpoint.bench.table import Cell, Column, Table
from farpoint.pose import PoseStatus

__all__ = ["coverage_summary"]

_COLUMNS = (
    Column("scenes"),
    Column("outliers_percent"),
    Column("matches"),
    Column("cells"),
    Column("pairs"),
    Column("OK"),
    Column("observable"),
    Column("observable_OK"),
    Column("pose_68", 3),
    Column("pose_95", 3),
    Column("pose_95_lowest", 3),
    Column("rotation_68", 3),
    Column("rotation_95", 3),
    Column("rotation_95_lowest", 3),
)
# Cells with fewer estimates are left out of the lowest share, because chance alone changes their
# shares by more than 0.06.
_LEAST = 50

_Cell = dict[str, Any]
"""A row of the table of coverage, by its columns."""


def coverage_summary(coverage: Table) -> Table:
    """Table with a row for each kind of scene, share of outliers and number of matches."""
    names = [column.name for column in coverage.columns]
    groups: dict[tuple[Cell, ...], list[_Cell]] = {}
    for row in coverage.rows:
        cell = dict(zip(names, row, strict=True))
        groups.setdefault((_scenes(cell), cell["outliers_percent"], cell["matches"]), []).append(
            cell
        )
    return Table(
        name="coverage_summary",
        title="Coverage by kind of scene: all cells of a kind together, and the lowest cell",
        command=coverage.command,
        columns=_COLUMNS,
        rows=tuple((*kind, *_figures(cells)) for kind, cells in sorted(groups.items())),
        notes=(
            "rotation only: scenes with baseline 0, so OK is a false alarm; far points only: no "
            "point is nearer than 25 m; near points: all other scenes",
            "observable, observable_OK: as in the table of coverage",
            "68, 95: shares of the regions that contain the truth; the pose of pairs that are "
            "OK, the rotation of all pairs that are not FAILED",
            f"lowest: the lowest share among cells with at least {_LEAST} estimates",
        ),
    )


def _scenes(cell: _Cell) -> str:
    if cell["baseline_cm"] == 0.0:
        return "rotation only"
    return "far points only" if cell["far_percent"] == 100 else "near points"


def _figures(cells: Sequence[_Cell]) -> tuple[Cell, ...]:
    ok, observable, observable_ok = (
        sum(cell[name] for cell in cells)
        for name in (PoseStatus.OK.value, "observable", "observable_OK")
    )
    pairs = [sum(cell[status.value] for status in PoseStatus) for cell in cells]
    poses = [0 if cell["pose_95"] is None else cell[PoseStatus.OK.value] for cell in cells]
    rotations = [
        total - cell[PoseStatus.FAILED.value] for total, cell in zip(pairs, cells, strict=True)
    ]
    return (
        len(cells),
        sum(pairs),
        ok,
        observable,
        observable_ok,
        *_shares(cells, "pose", poses),
        *_shares(cells, "rotation", rotations),
    )


def _shares(cells: Sequence[_Cell], kind: str, counts: Sequence[int]) -> tuple[Cell, ...]:
    """Shares of estimates whose 68 % and 95 % regions contain the truth.

    The third value is the lowest share, in any cell, for the 95 % regions.
    """
    counted = [(cell, count) for cell, count in zip(cells, counts, strict=True) if count]
    if not counted:
        return None, None, None
    total = sum(count for _, count in counted)
    share68, share95 = (
        sum(count * cell[f"{kind}_{level}"] for cell, count in counted) / total
        for level in (68, 95)
    )
    many = [cell[f"{kind}_95"] for cell, count in counted if count >= _LEAST]
    return share68, share95, min(many, default=None)
