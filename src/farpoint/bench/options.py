"""Options of the benchmark."""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, get_args

from farpoint.errors import InputError
from farpoint.options import coerce_int

__all__ = ["TABLES", "BenchOptions", "CoverageGrid", "Progress", "TableName"]

TableName = Literal[
    "paper",
    "accuracy",
    "time",
    "coverage",
    "pairs",
    "movers",
    "scenes",
    "pipeline",
    "drawing",
    "live",
    "lenses",
    "tracks",
    "codecs",
    "motions",
    "path",
    "lens",
    "steps",
    "halves",
]
TABLES: tuple[TableName, ...] = get_args(TableName)

# Tables that depend on `BenchOptions.data`, and tables that depend on `BenchOptions.full`.
_OF_DATA = ("pairs", "pipeline", "drawing", "motions", "path", "steps", "halves")
_FULLER = ("pairs", "coverage", "live")

Progress = Callable[[str, int, int], None]
"""Called with the name of a task, the number of finished steps and the number of all steps."""


@dataclass(frozen=True, kw_only=True)
class CoverageGrid:
    """Values whose combinations are the cells of the table of coverage.

    Attributes
    ----------
    baselines_m : tuple of float
        Lengths of the translation, m. The distances of near points are 1 to 4 m.
    far_shares : tuple of float
        Shares, 0 to 1, of inliers with a distance of 25 to 35 m.
    noises_px : tuple of float
        1-sigma of the noise of a coordinate, px.
    outlier_shares : tuple of float
        Shares, 0 to 1, of outliers among the matches.
    matches : tuple of int
        Numbers of matches, including outliers.
    trials : int
        Scenes in each cell.
    """

    baselines_m: tuple[float, ...] = (0.0, 0.02, 0.2)
    far_shares: tuple[float, ...] = (0.0, 0.5)
    noises_px: tuple[float, ...] = (0.22,)
    outlier_shares: tuple[float, ...] = (0.0, 0.2)
    matches: tuple[int, ...] = (90, 500)
    trials: int = 200

    def __post_init__(self) -> None:
        _check_each(self, "baselines_m", 0.0, math.inf)
        _check_each(self, "far_shares", 0.0, 1.0)
        _check_each(self, "noises_px", 0.0, math.inf)
        _check_each(self, "outlier_shares", 0.0, 1.0)
        _check_each(self, "matches", 1, math.inf)
        coerce_int(self, 1, "trials")

    @classmethod
    def whole(cls) -> CoverageGrid:
        """The grid of all scenes for which the covariances are promised. The table takes hours."""
        return cls(
            baselines_m=(0.0, 0.02, 0.05, 0.2),
            far_shares=(0.0, 0.5, 1.0),
            noises_px=(0.1, 0.22, 0.5, 1.0),
            outlier_shares=(0.0, 0.2, 0.5),
            matches=(20, 90, 500),
            trials=1000,
        )


@dataclass(frozen=True, kw_only=True)
class BenchOptions:
    """Options of `run_bench`.

    Attributes
    ----------
    tables : tuple of str
        Names of the tables.
    pairs : int or None
        Size of each table. The default sizes are given here in parentheses. The size is a number
        of pairs of views per cell (``paper`` 2000, ``accuracy`` 300, ``pairs`` 60, ``movers`` 60,
        ``scenes`` 60), pairs of frames per row (``lenses`` 40, ``tracks`` 60, ``codecs`` 60,
        ``motions`` 168, ``steps`` 40), scenes per number of matches (``time`` 30), frames
        (``pipeline`` 60, ``drawing`` 60), seconds of a session (``live`` 60), motions (``path``, by
        default 100 of each rendered drive or all of each sequence), or recordings per row
        (``lens`` 7).
    seed : int
        Seed of scenes and estimators. The same seed gives the same figures, except for times.
    data : tuple of Path
        Real data: files of matches (``.npz``), image sequences with calibrations, measured
        motions (TUM's format), or folders of such data. ``pairs`` needs files of matches. The
        tables ``halves`` and ``steps`` need image sequences; for ``steps`` the sequences must have
        true poses. The tables ``pipeline``, ``drawing`` and ``path`` use image sequences, and
        render drives if the data has none. ``path`` leaves out sequences without true poses. The
        table ``motions`` also moves the rendered camera along measured motions.
    full : bool
        Use every pair of the files of matches, the whole grid of the table of coverage, and a
        session of 10 minutes for ``live``. These tables take hours.
    grid : CoverageGrid
        Cells of the table of coverage.
    """

    tables: tuple[TableName, ...] = TABLES
    pairs: int | None = None
    seed: int = 0
    data: tuple[Path, ...] = ()
    full: bool = False
    grid: CoverageGrid = field(default_factory=CoverageGrid)

    def __post_init__(self) -> None:
        unknown = [name for name in self.tables if name not in TABLES]
        if unknown or not self.tables:
            raise InputError(
                f"expected some of {', '.join(TABLES)}, got {', '.join(unknown) or 'none'}",
                field="tables",
            )
        if self.pairs is not None:
            coerce_int(self, 1, "pairs")
        coerce_int(self, 0, "seed")
        if self.full and self.grid != CoverageGrid():
            raise InputError("expected the whole grid or parts of it, got both", field="full")

    def command(self, table: TableName) -> str:
        """The command line that makes one table with these options."""
        words = ["farpoint", "bench", "--tables", table]
        words += [] if self.pairs is None else ["--pairs", str(self.pairs)]
        words += ["--seed", str(self.seed)]
        if self.data and table in _OF_DATA:
            words += ["--data", *map(str, self.data)]
        words += ["--full"] if self.full and table in _FULLER else []
        if table == "coverage":
            words += _changed_words(self.grid)
        return shlex.join(words)


def _changed_words(grid: CoverageGrid) -> list[str]:
    words = []
    for name, default in vars(CoverageGrid()).items():
        value = getattr(grid, name)
        if value != default:
            values = value if isinstance(value, tuple) else (value,)
            words += [f"--grid.{name.replace('_', '-')}", *map(str, values)]
    return words


def _check_each(options: object, name: str, low: float, high: float) -> None:
    values = getattr(options, name)
    if not values or not all(math.isfinite(v) and low <= v <= high for v in values):
        bounds = f"of at least {low:g}" if math.isinf(high) else f"from {low:g} to {high:g}"
        raise InputError(f"expected numbers {bounds}, got {values}", field=name)
