"""The split-half test for several ways to split the tracks.

If the tracks are split by image cells, errors that neighbouring tracks share do not cancel.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from farpoint.bench.table import Cell, Column, Table
from farpoint.metrics import SplitHalf, evaluate_halves
from farpoint.odometry import Odometry, OdometryResult

__all__ = ["PARTS", "HalvesBySplit", "halves_by_cells", "split_halves"]

PARTS = "parts"
# Width of the image cells whose tracks stay in one half, px.
_CELLS_PX: dict[str, float | None] = {
    PARTS: None,
    "cells of 64 px": 64.0,
    "cells of 128 px": 128.0,
}

_COLUMNS = (
    Column("sequence"),
    Column("split_by"),
    Column("runs"),
    Column("pairs"),
    Column("compared"),
    Column("ratio", 2),
    Column("sigma_over_error", 2),
    Column("pose_68", 3),
    Column("pose_95", 3),
)

HalvesBySplit = dict[str, list[SplitHalf]]
"""Split-half tests of one run, by how the tracks are split."""


def split_halves(odometry: Odometry, results: Iterable[OdometryResult]) -> HalvesBySplit:
    """The split-half test on every pair of frames of a run, with each way to split the tracks."""
    halves: HalvesBySplit = {name: [] for name in _CELLS_PX}
    for result in results:
        if result.pose is not None:
            for name, cell_px in _CELLS_PX.items():
                halves[name].append(odometry.split_half(result, cell_px=cell_px))
    return halves


def halves_by_cells(sequences: Mapping[str, Sequence[HalvesBySplit]], command: str) -> Table:
    """A row for each sequence (given by several runs) and each way to split the tracks."""
    return Table(
        name="halves_by_cells",
        title="Halves of the tracks of real images, split by parts of the image and by image cells",
        command=command,
        columns=_COLUMNS,
        rows=tuple(
            (name, split_by, *_figures([run[split_by] for run in runs]))
            for name, runs in sequences.items()
            for split_by in _CELLS_PX
        ),
        notes=(
            "split_by: all tracks of one of 16 parts of the image, or of an image cell, are in the "
            "same half; errors common to the tracks of one part or cell do not cancel in the "
            "difference",
            "compared: pairs whose halves both have a direction; sigma_over_error, pose_68 and "
            "pose_95 are those of these pairs",
            "ratio: as in the table of halves; sigma_over_error: factor by which the sigmas are "
            "too large (above 1) for the median difference",
            "all runs together: those of the table of halves",
        ),
    )


def _figures(runs: Sequence[Sequence[SplitHalf]]) -> tuple[Cell, ...]:
    found = evaluate_halves([half for run in runs for half in run])
    return (
        len(runs),
        found.pairs,
        found.pose.count,
        found.ratio.ratio,
        found.pose.sigma_over_error,
        found.pose.coverage68.share,
        found.pose.coverage95.share,
    )
