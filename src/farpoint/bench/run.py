"""The tables, made one after the other and written to files while rows are added."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

from farpoint.bench.estimators import peer_versions
from farpoint.bench.options import BenchOptions, Progress, TableName
from farpoint.bench.table import Table
from farpoint.bench.tables.accuracy import accuracy_table
from farpoint.bench.tables.codecs import codecs_table
from farpoint.bench.tables.coverage import coverage_table
from farpoint.bench.tables.drawing import drawing_table
from farpoint.bench.tables.halves import halves_table
from farpoint.bench.tables.lens import lens_table
from farpoint.bench.tables.lenses import unprojection_table, wide_table
from farpoint.bench.tables.live import live_tables
from farpoint.bench.tables.motions import motions_table
from farpoint.bench.tables.movers import movers_table
from farpoint.bench.tables.pairs import pairs_table
from farpoint.bench.tables.paper import paper_table
from farpoint.bench.tables.path import path_tables
from farpoint.bench.tables.pipeline import pipeline_table
from farpoint.bench.tables.scaling import scaling_tables
from farpoint.bench.tables.scenes import scenes_table
from farpoint.bench.tables.start import start_table
from farpoint.bench.tables.steps import steps_table
from farpoint.bench.tables.timing import timing_table
from farpoint.bench.tables.tracks import tracks_table
from farpoint.errors import InputError, MissingExtraError

__all__ = ["BenchReport", "run_bench"]

# Yields tables. A table may be yielded several times, each time with more rows.
_Maker = Callable[[BenchOptions, Progress], Iterable[Table]]
_MAKERS: dict[TableName, tuple[_Maker, ...]] = {
    "paper": (paper_table,),
    "accuracy": (accuracy_table,),
    "time": (timing_table, scaling_tables, start_table),
    "coverage": (coverage_table,),
    "pairs": (pairs_table,),
    "movers": (movers_table,),
    "scenes": (scenes_table,),
    "pipeline": (pipeline_table,),
    "lenses": (unprojection_table, wide_table),
    "tracks": (tracks_table,),
    "codecs": (codecs_table,),
    "motions": (motions_table,),
    "path": (path_tables,),
    "lens": (lens_table,),
    "steps": (steps_table,),
    "halves": (halves_table,),
    "drawing": (drawing_table,),
    "live": (live_tables,),
}
# Data that a table needs, named in the report if the table is skipped.
_NEEDED: dict[TableName, str] = {
    "pairs": "files of matches (.npz)",
    "steps": "image sequences with a calibration and true poses",
    "halves": "image sequences with a calibration",
    "path": "image sequences with true poses",
}


@dataclass(frozen=True, kw_only=True)
class BenchReport:
    """Result of `run_bench`.

    Attributes
    ----------
    date : str
        Day of the run in UTC, as in 2026-11-28.
    environment : str
        Machine, versions of libraries, and names of the peers that are not installed.
    tables : tuple of Table
        Tables in the requested order.
    skipped : tuple of str
        Tables that could not be made, with the reason.
    """

    date: str
    environment: str
    tables: tuple[Table, ...]
    skipped: tuple[str, ...]

    @property
    def heading(self) -> str:
        """Date and environment in which the tables were made."""
        return f"{self.environment}\n{self.date} (UTC)"

    def to_text(self) -> str:
        """The whole report as text, as in ``bench.txt``."""
        parts = [self.heading, *(table.to_text() for table in self.tables), *self.skipped]
        return "\n\n\n".join(parts) + "\n"


def run_bench(
    options: BenchOptions,
    out: Path,
    progress: Progress,
    *,
    show: Callable[[str], None],
) -> BenchReport:
    """Make the tables and write them to a folder.

    ``bench.txt`` has all tables. Each table also has a ``<table>.csv`` and a ``<table>.json``, and
    a ``<table>.svg`` if the table has a chart. Each table is written as soon as the table is
    finished. A table that takes hours is written after every row, so that an interruption loses no
    finished row.

    Parameters
    ----------
    options : BenchOptions
        Options of the tables, such as names and sizes.
    out : Path
        Folder for the files; a missing folder is created.
    progress : callable
        Called with the current task, the number of finished steps and the number of all steps.
    show : callable
        Called with the text of each part of the report as soon as it is known.

    Raises
    ------
    InputError
        If the folder cannot be written or the data cannot be read.
    """
    _check_data(options.data)
    today = datetime.now(UTC).date().isoformat()
    report = BenchReport(date=today, environment=_environment(), tables=(), skipped=())
    show(report.heading)
    _write(out, "bench.txt", report.to_text())
    for name in options.tables:
        for make in _MAKERS[name]:
            before = report
            for report in _scaling(before, name, lambda make=make: make(options, progress)):
                for table in report.tables[len(before.tables) :]:
                    _write_table(out, table, report)
                _write(out, "bench.txt", report.to_text())
            for table in report.tables[len(before.tables) :]:
                show("\n\n" + table.to_text())
            for reason in report.skipped[len(before.skipped) :]:
                show("\n\n" + reason)
    return report


def _scaling(
    report: BenchReport, name: TableName, make: Callable[[], Iterable[Table]]
) -> Iterator[BenchReport]:
    """The report, yielded after each table and after further rows of a table.

    If there is no table, the report states the reason.
    """
    made: dict[str, Table] = {}
    reason = f"--data names no {_NEEDED.get(name, 'data')}"
    try:
        for table in make():
            made[table.name] = table
            yield replace(report, tables=(*report.tables, *made.values()))
    except MissingExtraError as error:
        reason = str(error)
    if not made:
        yield replace(report, skipped=(*report.skipped, f"{name}: skipped, {reason}"))


def _write_table(out: Path, table: Table, report: BenchReport) -> None:
    _write(out, f"{table.name}.csv", table.to_csv())
    about_run = {"date": report.date, "environment": report.environment}
    _write(out, f"{table.name}.json", table.to_json(**about_run))
    if table.chart is not None:
        _write(out, f"{table.name}.svg", table.chart)


def _check_data(places: tuple[Path, ...]) -> None:
    for place in places:
        if not place.exists():
            raise InputError("no such file or folder", file=place, field="data")


def _write(out: Path, name: str, text: str) -> None:
    """Replace a file in one step, so that an interruption leaves the old file or the new one."""
    target, partial = out / name, out / f".{name}.part"
    try:
        out.mkdir(parents=True, exist_ok=True)
        partial.write_text(text, encoding="utf-8")
        partial.replace(target)
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror}", file=target) from error


def _environment() -> str:
    versions = [f"farpoint {metadata.version('farpoint')}", f"Python {platform.python_version()}"]
    versions += [f"{name} {metadata.version(name)}" for name in ("numpy", "numba")]
    peers = peer_versions()
    present = [f"{name} {version}" for name, version in peers.items() if version]
    absent = [name for name, version in peers.items() if not version]
    lines = [
        f"farpoint bench on {_processor()}, {os.cpu_count()} cores, {platform.system()}",
        ", ".join(versions),
        f"peers: {', '.join(present) or 'none'}",
    ]
    return "\n".join(lines + ([f"absent: {', '.join(absent)}"] if absent else []))


def _processor() -> str:
    """Name of the processor, if the system reports the name."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
