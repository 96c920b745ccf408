"""Figures of the README are those of ``docs/measured``, rounded."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
MEASURED = ROOT / "docs" / "measured"

Row = dict[str, Any]


def measured(file: str) -> list[Row]:
    """Rows of a table, by its columns."""
    table = json.loads((MEASURED / f"{file}.json").read_text())
    names = [column["name"] for column in table["columns"]]
    return [dict(zip(names, row, strict=True)) for row in table["rows"]]


def only(file: str, **where: Any) -> Row:
    """The row of a table with these cells."""
    [row] = [row for row in measured(file) if all(row[k] == v for k, v in where.items())]
    return row


def tables_of(text: str, heading: str) -> list[list[Row]]:
    """Tables of a section, each of them as rows by its columns."""
    [section] = re.findall(rf"^## {heading}$(.*?)(?=^## |\Z)", text, re.M | re.S)
    tables = re.findall(r"(?:^\|.*\n)+", section, re.M)
    return [_rows(table) for table in tables]


def _rows(table: str) -> list[Row]:
    lines = [[c.strip() for c in line.strip("|").split("|")] for line in table.splitlines()]
    header, _, *rows = lines
    return [dict(zip(header, row, strict=True)) for row in rows]


def differences(
    rows: list[Row], find: Callable[[Row], Row], columns: dict[str, str]
) -> list[tuple[str, str, float]]:
    """Figures that are not those measured, rounded to as many digits as are written."""
    wrong = []
    for row in rows:
        found = find(row)
        for column, name in columns.items():
            if row[column]:
                digits = len(row[column].partition(".")[2])
                if f"{found[name]:.{digits}f}" != row[column]:
                    wrong.append((column, row[column], found[name]))
    return wrong


ACCURACY = {
    "cases": "cases",
    "rotation": "rotation_ratio",
    "direction": "direction_ratio",
    "better": "better",
    "worse": "worse",
}
PAPER = {
    "rotation x": "rotation_x_deg",
    "rotation y": "rotation_y_deg",
    "rotation z": "rotation_z_deg",
    "direction": "direction_deg",
}
PAPER_METHODS = {
    "Burschka and Mair (2008)": "Burschka & Mair 2008",
    "farpoint, their closed form": "farpoint, closed form",
    "farpoint": "farpoint",
    "Cramer-Rao bound, depths unknown": "Cramer-Rao bound",
}
HONESTY = {"pose": "pose_95", "rotation": "rotation_95"}


def near(outliers: int, matches: int) -> Row:
    return only(
        "coverage_summary", scenes="near points", outliers_percent=outliers, matches=matches
    )


def turned(outliers: int, matches: int) -> Row:
    return only(
        "coverage_summary", scenes="rotation only", outliers_percent=outliers, matches=matches
    )
