"""The directive ``measured``: a table of ``farpoint bench``, from the JSON file that it wrote.

    ```{measured} halves
    :columns: sequence, ratio, pose_95 as pose in 95 %
    :where: estimator = farpoint, matches = 90 | 500
    ```

renders ``measured/halves.json``, with the command and the day of the run below. ``columns`` are the
columns to show, in this order, with other headings where ``as`` gives them; without it all are
shown. ``where`` keeps the rows whose columns have one of these values. A file that is missing or
damaged, and a column that it does not have, end the build.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util.docutils import SphinxDirective

FOLDER = "measured"

_FIELDS = {"date": str, "environment": str, "command": str, "columns": list, "rows": list}

Cell = str | int | float | None


@dataclass(frozen=True, kw_only=True)
class MeasuredTable:
    """What a file holds, or a part of it.

    Attributes
    ----------
    date, command : str
        When and how it was made.
    columns : tuple of str
        Names.
    decimals : tuple of int
        Digits behind the point, for each column.
    rows : tuple of tuple of Cell
    """

    date: str
    command: str
    columns: tuple[str, ...]
    decimals: tuple[int, ...]
    rows: tuple[tuple[Cell, ...], ...]

    def index(self, column: str) -> int:
        """Place of a column; ValueError without it."""
        if column not in self.columns:
            raise ValueError(f"no column {column!r}, only {', '.join(self.columns)}")
        return self.columns.index(column)

    def where(self, conditions: dict[str, set[str]]) -> MeasuredTable:
        """The rows in which every column named has one of the values; ValueError without any."""
        kept = [(self.index(column), values) for column, values in conditions.items()]
        rows = tuple(row for row in self.rows if all(_word(row[k]) in v for k, v in kept))
        if not rows:
            raise ValueError(f"no row where {conditions}")
        return _replaced(self, rows=rows)

    def select(self, columns: list[str]) -> MeasuredTable:
        """These columns alone, in this order."""
        places = [self.index(column) for column in columns]
        return _replaced(
            self,
            columns=tuple(columns),
            decimals=tuple(self.decimals[k] for k in places),
            rows=tuple(tuple(row[k] for k in places) for row in self.rows),
        )

    def texts(self) -> list[list[str]]:
        """The cells of each row as the page shows them."""
        return [
            [_shown(cell, digits) for cell, digits in zip(row, self.decimals, strict=True)]
            for row in self.rows
        ]


def read_table(path: Path) -> MeasuredTable:
    """Read a file of ``farpoint bench``; ValueError names the file and what is wrong with it."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error
    if not isinstance(found, dict):
        raise ValueError(f"{path}: expected an object")
    for field, kind in _FIELDS.items():
        if not isinstance(found.get(field), kind):
            raise ValueError(f"{path}: {field}: expected a {kind.__name__}")
    try:
        table = MeasuredTable(
            date=found["date"],
            command=found["command"],
            columns=tuple(column["name"] for column in found["columns"]),
            decimals=tuple(int(column["decimals"]) for column in found["columns"]),
            rows=tuple(tuple(row) for row in found["rows"]),
        )
    except (KeyError, TypeError) as error:
        raise ValueError(f"{path}: columns or rows: {error!r}") from error
    if not table.rows or any(len(row) != len(table.columns) for row in table.rows):
        raise ValueError(f"{path}: rows: expected some, each of {len(table.columns)} cells")
    return table


def parse_columns(text: str) -> dict[str, str]:
    """Columns with their headings, of the option ``columns``."""
    entries = [[part.strip() for part in entry.split(" as ", 1)] for entry in text.split(",")]
    return {entry[0]: entry[-1] for entry in entries}


def parse_conditions(text: str) -> dict[str, set[str]]:
    """Columns with the values to keep, of the option ``where``; ValueError without a value."""
    conditions = {}
    for entry in text.split(","):
        column, equals, values = entry.partition("=")
        if not equals:
            raise ValueError(f"expected COLUMN = VALUE, got {entry.strip()!r}")
        conditions[column.strip()] = {value.strip() for value in values.split("|")}
    return conditions


def _replaced(table: MeasuredTable, **changes: Any) -> MeasuredTable:
    return MeasuredTable(**{**vars(table), **changes})


def _word(cell: Cell) -> str:
    """A value as ``where`` names it."""
    return f"{cell:g}" if isinstance(cell, float) else "" if cell is None else str(cell)


def _shown(cell: Cell, decimals: int) -> str:
    return f"{cell:.{decimals}f}" if isinstance(cell, float) else "" if cell is None else str(cell)


class Measured(SphinxDirective):
    """The table, its command and its day."""

    required_arguments = 1
    option_spec: ClassVar = {"columns": directives.unchanged, "where": directives.unchanged}

    def run(self) -> list[nodes.Node]:
        path = Path(self.env.srcdir) / FOLDER / f"{self.arguments[0]}.json"
        self.env.note_dependency(str(path))
        try:
            table = read_table(path)
            headings = parse_columns(self.options.get("columns", ",".join(table.columns)))
            if "where" in self.options:
                table = table.where(parse_conditions(self.options["where"]))
            table = table.select(list(headings))
        except ValueError as error:
            place = f"{self.env.docname}.md:{self.lineno}"
            problem = str(error) if str(path) in str(error) else f"{path}: {error}"
            raise ExtensionError(f"{place}: {problem}") from error
        return [_table_node(list(headings.values()), table), _source_node(table)]


def _table_node(headings: list[str], table: MeasuredTable) -> nodes.table:
    words = [
        all(isinstance(row[k], str | None) for row in table.rows) for k in range(len(headings))
    ]
    texts = table.texts()
    group = nodes.tgroup("", cols=len(headings))
    group += [
        nodes.colspec("", colwidth=max(map(len, column)))
        for column in zip(headings, *texts, strict=True)
    ]
    group += nodes.thead("", _row_node(headings, words))
    group += nodes.tbody("", *(_row_node(row, words) for row in texts))
    return nodes.table("", group, classes=["measured", "colwidths-auto"])


def _row_node(texts: list[str], words: list[bool]) -> nodes.row:
    """Words to the left, numbers to the right."""
    return nodes.row(
        "",
        *(
            nodes.entry("", nodes.paragraph("", text), classes=[f"text-{'left' if w else 'right'}"])
            for text, w in zip(texts, words, strict=True)
        ),
    )


def _source_node(table: MeasuredTable) -> nodes.paragraph:
    return nodes.paragraph(
        "",
        "",
        nodes.literal("", table.command),
        nodes.Text(f", {table.date}"),
        classes=["measured-source"],
    )


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_directive("measured", Measured)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
