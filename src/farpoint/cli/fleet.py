"""``farpoint fleet``: runs of many drives, summarised in one table."""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated

import tyro

from farpoint.cli.common import RecordedOptions
from farpoint.cli.progress import Progress
from farpoint.cli.run import Run
from farpoint.cli.wrong_usage import in_one_line
from farpoint.errors import InputError, optional_import, require
from farpoint.fleet import ClusterOptions, Drive, ListedDrive, list_drives, run_fleet

__all__ = ["Fleet"]

_FAILED = 1


@dataclass(frozen=True, kw_only=True)
class Fleet(RecordedOptions):
    """Run each of many drives once, in parallel with Dask, and write one table of all drives.

    Attributes
    ----------
    sources : tuple of str
        Sources of farpoint run, patterns of sources, or lists of sources. A list is a CSV file with
        a column named source and further columns named after options, or a text file with a source
        and a calibration in each line.
    cluster : ClusterOptions
        Options of the workers.
    out : Path
        Folder for the tables and the outputs of every drive.
    """

    sources: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="SOURCES")]
    cluster: Annotated[ClusterOptions, tyro.conf.arg(name="")] = field(
        default_factory=ClusterOptions
    )
    out: Path = Path("farpoint-out/fleet")

    def __call__(self) -> int:
        """Run the command and return the exit code."""
        for library in ("dask", "distributed"):
            require(library, extra="dask", purpose="running a fleet")
        if self.output.parquet:
            optional_import("pyarrow", extra="parquet", purpose="writing Parquet")
        drives = [self._drive(listed) for listed in list_drives(self.sources)]
        repeated = [name for name, count in Counter(d.name for d in drives).items() if count > 1]
        if repeated:
            raise InputError("is listed twice with the same options", file=repeated[0])
        outcome = run_fleet(
            drives,
            self.out,
            self.cluster,
            lambda count: Progress("drives", count),
            parquet=self.output.parquet,
        )
        before = f" ({outcome.before} of them before)" if outcome.before else ""
        print(f"{len(drives)} drives: {outcome.done} done{before}, {outcome.failed} failed")
        print(f"results in {self.out}")
        if outcome.failed:
            print(f"farpoint: {outcome.failed} drives failed: {self.out}/fleet.csv has the causes",
                  file=sys.stderr)  # fmt: skip
        return _FAILED if outcome.failed else 0

    def _drive(self, listed: ListedDrive) -> Drive:
        options = {one.name: getattr(self, one.name) for one in fields(RecordedOptions)}
        run = Run(source=listed.source, **options)
        words = [word for name, value in listed.options.items() for word in _typed(name, value)]
        if words:
            run = in_one_line(
                lambda: tyro.cli(Run, args=words, default=run, prog="farpoint run"),
                see=f"{listed.place} and farpoint run --help",
            )
        if run.viewer.wanted or run.out is not None or run.source != listed.source:
            raise InputError("of a drive: no column out, show or rrd expected", file=listed.place)
        return Drive(
            source=listed.source,
            camera=str(run.lens.camera or ""),
            options=run,
            run=_RunInto(run),
            own_options=" ".join(words),
        )


def _typed(name: str, value: str) -> list[str]:
    """An option in a list as arguments of the command line; the value of a switch is a boolean."""
    if value.lower() == "true":
        return [f"--{name}"]
    if value.lower() == "false":
        group, dot, switch = name.rpartition(".")
        return [f"--{group}{dot}no-{switch}"]
    return [f"--{name}", value]


@dataclass(frozen=True)
class _RunInto:
    """The run of a drive on a worker, called with the folder for the outputs."""

    run: Run

    def __call__(self, folder: Path) -> None:
        replace(self.run, out=folder)()
