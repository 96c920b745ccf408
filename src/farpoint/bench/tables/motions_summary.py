"""Summary of the table of motions, in which a row stands for all recordings of one kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from farpoint.bench.rendered import (
    RENDERED_COLUMNS,
    RENDERED_NOTES,
    RenderedErrors,
    joined,
    rendered_cells,
)
from farpoint.bench.table import Cell, Column, Table

__all__ = ["MotionErrors", "motions_summary"]

_FIGURES = ("pairs", "OK", "pose_95", "rotation_95", "direction_95")
_NAMES = [column.name for column in RENDERED_COLUMNS]


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionErrors:
    """Data of a row in the table of motions.

    Attributes
    ----------
    kind : str
        Name of the kind of motion, which is the same for recordings that belong together.
    fps : float
        Frames per second.
    lens : str
    streets : int
        Number of rendered streets through which the camera moves.
    errors : RenderedErrors
        Errors in all these streets.
    """

    kind: str
    fps: float
    lens: str
    streets: int
    errors: RenderedErrors


def motions_summary(found: Sequence[MotionErrors], command: str) -> Table:
    """A row for each kind of motion, frame rate and lens."""
    groups: dict[tuple[str, float, str], list[MotionErrors]] = {}
    for one in found:
        groups.setdefault((one.kind, one.fps, one.lens), []).append(one)
    return Table(
        name="motions_summary",
        title="Odometry over rendered streets: all motions of a kind together",
        command=command,
        columns=(
            Column("motion"),
            Column("fps"),
            Column("lens"),
            Column("streets"),
            *(RENDERED_COLUMNS[_NAMES.index(name)] for name in _FIGURES),
        ),
        rows=tuple(
            (kind, round(fps), lens, sum(one.streets for one in group), *_cells(group))
            for (kind, fps, lens), group in groups.items()
        ),
        notes=(
            "motion: a drive, or the name of the file of a measured motion up to the first digit",
            RENDERED_NOTES[-1],
        ),
    )


def _cells(group: Sequence[MotionErrors]) -> list[Cell]:
    cells = rendered_cells(joined([one.errors for one in group]))
    return [cells[_NAMES.index(name)] for name in _FIGURES]
