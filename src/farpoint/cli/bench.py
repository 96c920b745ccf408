"""``farpoint bench``: accuracy, coverage and time of farpoint and of installed peer libraries."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from farpoint.bench.options import BenchOptions

__all__ = ["Bench"]


@dataclass(frozen=True, kw_only=True)
class Bench:
    """Compute tables of accuracy, coverage and time for farpoint and installed peer libraries.

    Attributes
    ----------
    out : Path
        Folder for the tables.
    options : BenchOptions
        Options of the tables, such as names and sizes.
    """

    out: Path = Path("farpoint-out/bench")
    options: Annotated[BenchOptions, tyro.conf.arg(name="")] = field(default_factory=BenchOptions)

    def __call__(self) -> None:
        """Run the command."""
        # Imported on use: the import loads the renderer, which other commands do not need.
        from farpoint.bench.run import run_bench

        run_bench(self.options, self.out, _StepsOnStderr(), show=print)


class _StepsOnStderr:
    """A progress line for each part of the work, updated on a terminal."""

    def __init__(self) -> None:
        self._terminal = sys.stderr.isatty()
        self._what = ""

    def __call__(self, what: str, done: int, total: int) -> None:
        if self._terminal:
            end = "\n" if done == total else ""
            print(f"\r\x1b[K{what}: {done}/{total}", end=end, file=sys.stderr, flush=True)
        elif what != self._what:
            print(f"{what}: {total} steps", file=sys.stderr, flush=True)
        self._what = what
