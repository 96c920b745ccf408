"""A table, written as text for people, and as CSV and JSON for programs."""

from __future__ import annotations

import csv
import io
import json
import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["Cell", "Column", "Table"]

_WRAP = 100

Cell = str | int | float | None
"""Content of a cell. None and NaN are missing figures, which are empty in text and CSV."""


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes
    ----------
    name : str
        Name with the unit, the same in text, CSV and JSON. A column whose name ends in ``_ms``,
        ``_s`` or ``_fps`` or begins with ``time_`` has times on this machine. Only such columns
        differ from run to run.
    decimals : int
        Digits after the decimal point in the text. CSV and JSON have six significant digits.
    """

    name: str
    decimals: int = 0


@dataclass(frozen=True, kw_only=True)
class Table:
    """One table of the benchmark.

    Attributes
    ----------
    name : str
        File name without suffix.
    title : str
        Content of the table, in one line.
    command : str
        The command that makes the table.
    columns : tuple of Column
    rows : tuple of tuple of Cell
        One cell for each column.
    notes : tuple of str
        Explanations that a reader of the table needs.
    chart : str or None
        Chart of the table as SVG.
    """

    name: str
    title: str
    command: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    notes: tuple[str, ...] = ()
    chart: str | None = None

    def to_text(self) -> str:
        """Title, command, aligned columns (words left, numbers right) and notes."""
        cells = [[column.name for column in self.columns]]
        cells += [
            [
                _formatted(cell, column.decimals)
                for cell, column in zip(row, self.columns, strict=True)
            ]
            for row in self.rows
        ]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        words = [
            all(isinstance(row[i], str | None) for row in self.rows)
            for i in range(len(self.columns))
        ]
        lines = [_aligned(row, widths, words) for row in cells]
        lines.insert(1, "  ".join("-" * width for width in widths))
        notes = [textwrap.fill(f"- {note}", _WRAP, subsequent_indent="  ") for note in self.notes]
        return "\n".join([self.title, f"$ {self.command}", "", *lines, *[""][: len(notes)], *notes])

    def to_csv(self) -> str:
        """A header and a line for each row."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow([column.name for column in self.columns])
        for row in self.rows:
            writer.writerow([_written(cell) for cell in row])
        return text.getvalue()

    def to_json(self, **run: str) -> str:
        """JSON object with the attributes of the table except its chart; each row is on one line.

        A missing figure is null, and an infinite figure is the word ``inf``.

        Parameters
        ----------
        **run : str
            Further entries: date and environment of the run.
        """
        fields = {
            **{name: json.dumps(value) for name, value in run.items()},
            "name": json.dumps(self.name),
            "title": json.dumps(self.title),
            "command": json.dumps(self.command),
            "columns": _lines([{"name": c.name, "decimals": c.decimals} for c in self.columns]),
            "rows": _lines([[_plain(cell) for cell in row] for row in self.rows]),
            "notes": _lines(self.notes),
        }
        return "{\n" + ",\n".join(f'"{name}": {text}' for name, text in fields.items()) + "\n}\n"


def _lines(values: Sequence[object]) -> str:
    """A list in JSON, with each value on a separate line."""
    return "[" + ",".join(f"\n  {json.dumps(value)}" for value in values) + "\n]"


def _plain(cell: Cell) -> Cell:
    """The value of a cell in JSON."""
    if cell is None or isinstance(cell, str):
        return cell
    if isinstance(cell, float):
        rounded = float(f"{cell:.6g}")
        return rounded if math.isfinite(rounded) else None if math.isnan(rounded) else str(rounded)
    return int(cell)  # NumPy's integers, too


def _written(cell: Cell) -> str:
    if cell is None or cell != cell:  # only NaN differs from itself
        return ""
    return f"{cell:.6g}" if isinstance(cell, float) else str(cell)


def _formatted(cell: Cell, decimals: int) -> str:
    if cell is None or cell != cell:
        return ""
    return f"{cell:.{decimals}f}" if isinstance(cell, float) else str(cell)


def _aligned(row: Sequence[str], widths: Sequence[int], words: Sequence[bool]) -> str:
    fields = [
        cell.ljust(width) if word else cell.rjust(width)
        for cell, width, word in zip(row, widths, words, strict=True)
    ]
    return "  ".join(fields).rstrip()
