"""Summary of the table of steps: errors of farpoint divided by errors of each peer."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from farpoint.bench.table import Cell, Column, Table

__all__ = ["steps_summary"]

_COLUMNS = (
    Column("sequence"),
    Column("peer"),
    Column("cases"),
    Column("rotation_ratio", 2),
    Column("better"),
    Column("worse"),
    Column("direction_ratio", 2),
    Column("gross"),
    Column("gross_of_peer"),
)
_ALL = "all together"

_Row = dict[str, Any]
"""A row of the table of steps, by its columns."""


def steps_summary(steps: Table) -> Table:
    """A row for each sequence and peer, and a row for each peer over all sequences."""
    names = [column.name for column in steps.columns]
    cases: list[list[_Row]] = []  # rows of one sequence, kind and step, farpoint's first
    for cells in steps.rows:
        row = dict(zip(names, cells, strict=True))
        if row["estimator"] == "farpoint":
            cases.append([])
        cases[-1].append(row)
    sequences = dict.fromkeys(case[0]["sequence"] for case in cases)
    rows = [
        row
        for sequence in (*sequences, _ALL)
        for row in _rows(sequence, [c for c in cases if sequence in (c[0]["sequence"], _ALL)])
    ]
    return Table(
        name="steps_summary",
        title="Real images several frames apart: farpoint's errors over those of each peer",
        command=steps.command,
        columns=_COLUMNS,
        rows=tuple(rows),
        notes=(
            "cases: kinds of matches and steps; ratios: mean error of farpoint over that of the "
            "peer, geometric mean over the cases, below 1 if farpoint is more accurate; "
            "rotations of the pairs that both estimate, directions of all estimates",
            "better, worse: cases in which the mean rotation error of farpoint is smaller or "
            "larger beyond chance (95 %)",
            "gross: estimates whose rotation is more than 1 deg off or whose direction is more "
            "than 30 deg off",
        ),
    )


def _rows(sequence: str, cases: Sequence[Sequence[_Row]]) -> Iterable[tuple[Cell, ...]]:
    peers = dict.fromkeys(row["estimator"] for case in cases for row in case[1:])
    for peer in peers:
        pairs = [(case[0], row) for case in cases for row in case[1:] if row["estimator"] == peer]
        theirs = [row for _, row in pairs]
        yield (
            sequence,
            peer,
            len(pairs),
            _geometric_mean(1.0 / row["rotation_over_farpoint"] for row in theirs),
            sum(row["rotation_over_low"] > 1.0 for row in theirs),
            sum(row["rotation_over_high"] < 1.0 for row in theirs),
            _geometric_mean(
                ours["direction_mean_deg"] / row["direction_mean_deg"] for ours, row in pairs
            ),
            sum(ours["gross"] for ours, _ in pairs),
            sum(row["gross"] for row in theirs),
        )


def _geometric_mean(ratios: Iterable[float]) -> float | None:
    """Geometric mean of the positive finite ratios; None if there are none."""
    logs = [math.log(ratio) for ratio in ratios if math.isfinite(ratio) and ratio > 0.0]
    return math.exp(math.fsum(logs) / len(logs)) if logs else None
