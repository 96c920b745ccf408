"""A fleet: unfinished drives are run on workers, and one table of all drives is written."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from farpoint.fleet.cluster import Cluster, ClusterOptions, open_cluster
from farpoint.fleet.drive import Drive
from farpoint.fleet.folder import DRIVES, clear_unfinished, facts_of, is_finished
from farpoint.fleet.page import write_page
from farpoint.fleet.table import Row, row_of, write_tables
from farpoint.fleet.work import Work, do_drive, one_line
from farpoint.interrupts import interruptible
from farpoint.sinks import FolderLock

__all__ = ["FleetOutcome", "Reporter", "run_fleet"]

_LOOK_S = 0.2


class Reporter(Protocol):
    """Progress display."""

    def reach(self, done: int, note: str = "") -> None:
        """Show the number of finished drives."""


@dataclass(frozen=True, kw_only=True)
class FleetOutcome:
    """Result of a fleet.

    Attributes
    ----------
    done, failed : int
        Number of drives with results, and number of drives without results.
    before : int
        Number of drives in `done` that an earlier run of the fleet finished.
    """

    done: int
    failed: int
    before: int


def run_fleet(
    drives: Sequence[Drive],
    out: Path,
    cluster: ClusterOptions,
    reporting: Callable[[int], Any],
    parquet: bool = False,
) -> FleetOutcome:
    """Run all unfinished drives and write the tables, even after Ctrl-C.

    Parameters
    ----------
    drives : sequence of Drive
        Drives with different names.
    out : Path
        Folder of the fleet, which workers must see under the same path.
    cluster : ClusterOptions
        Options of the workers.
    reporting : callable
        Called with the number of drives to run; returns a context manager that yields a `Reporter`.
    parquet : bool
        Write ``fleet.parquet`` in addition to ``fleet.csv``.

    Raises
    ------
    InputError
        If another run writes into ``out``, if ``out`` cannot be written, or if no scheduler
        answers.
    """
    out = out.absolute()
    with FolderLock(out), interruptible():
        clear_unfinished(out / DRIVES)
        every = [Work(drive=d, folder=out / DRIVES / d.name, key=d.key()) for d in drives]
        waiting = [work for work in every if not is_finished(work.folder, work.key)]
        errors: dict[str, str] = {}
        try:
            if waiting:
                with open_cluster(cluster) as opened, reporting(len(waiting)) as reporter:
                    _run(opened, waiting, errors, reporter)
        finally:
            clear_unfinished(out / DRIVES)  # of workers that were killed
            rows = [_row(work, errors) for work in every]
            write_tables(out, rows, parquet)
            write_page(out, rows)
    done = sum(row.state == "done" for row in rows)
    return FleetOutcome(done=done, failed=len(rows) - done, before=len(every) - len(waiting))


def _run(
    cluster: Cluster,
    waiting: Sequence[Work],
    errors: dict[str, str],
    reporter: Reporter,
) -> None:
    from distributed import KilledWorker, as_completed

    by_key = {f"drive-{work.drive.name}-{work.key[:12]}": work for work in waiting}
    finished = as_completed(
        cluster.client.submit(do_drive, work, key=key, pure=False, priority=-index)
        for index, (key, work) in enumerate(by_key.items())
    )
    count = 0
    while not finished.is_empty():
        time.sleep(_LOOK_S)
        cluster.look_after()
        for future in finished.next_batch(block=False):
            name = by_key[future.key].drive.name
            try:
                error = future.result()
            except KilledWorker:
                error = cluster.deaths
            except Exception as fault:  # such as a drive that cannot be sent
                error = one_line(fault)
            if error is not None:
                errors[name] = error
            count += 1
            reporter.reach(count, f"{len(errors)} failed" if errors else "")


def _row(work: Work, errors: dict[str, str]) -> Row:
    drive, error = work.drive, errors.get(work.drive.name)
    finished = error is None and is_finished(work.folder, work.key)
    return row_of(drive, facts_of(work.folder) if finished else None, error)
