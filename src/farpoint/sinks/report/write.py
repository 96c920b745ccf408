"""From a folder's files to its ``report.html``."""

from __future__ import annotations

from pathlib import Path

from farpoint.errors import InputError
from farpoint.sinks.report.digest import digest_motions, path_from_above
from farpoint.sinks.report.page import PageContents, render_page
from farpoint.sinks.report.stills import stills_of
from farpoint.sinks.run_record import read_run

__all__ = ["REPORT_NAME", "write_report"]

REPORT_NAME = "report.html"

_STILLS = 8


def write_report(folder: str | Path) -> Path:
    """Write ``report.html`` from the other files of a folder, of an interrupted run too.

    It is a function of those files: ``run.json``, ``motions.csv``, ``trajectory.tum`` and, where
    it is there, ``overlay.mp4``. Its size and the memory it takes do not grow with the run.

    Returns
    -------
    Path
        The page: one file that asks nothing of the network.

    Raises
    ------
    InputError
        If one of the files is missing or damaged, or the page cannot be written.
    """
    folder = Path(folder)
    page = PageContents(
        run=read_run(folder / "run.json"),
        digest=digest_motions(folder / "motions.csv"),
        path_x_z=path_from_above(folder / "trajectory.tum"),
        stills=stills_of(folder / "overlay.mp4", _STILLS),
    )
    path = folder / REPORT_NAME
    try:
        path.write_text(render_page(page), encoding="utf-8", newline="\n")
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror}", file=path) from error
    return path
