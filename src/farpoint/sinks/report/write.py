"""Writing of ``report.html`` from the files of a folder."""

from __future__ import annotations

from pathlib import Path

from farpoint.sinks.files import replacing
from farpoint.sinks.halves import read_halves
from farpoint.sinks.report.digest import digest_motions
from farpoint.sinks.report.page import PageContents, render_page
from farpoint.sinks.report.paths import paths_from_above
from farpoint.sinks.report.stills import stills_at, thumbs_of
from farpoint.sinks.run_record import read_run

__all__ = ["REPORT_NAME", "write_report"]

REPORT_NAME = "report.html"

_THUMBS = 80


def write_report(folder: str | Path, truth: str | Path | None = None) -> Path:
    """Write ``report.html`` from the other files of a folder, even if the run was interrupted.

    The report depends on ``run.json``, ``motions.csv``, ``positions.csv`` (or ``trajectory.tum``)
    and, if present, ``halves.csv`` and ``overlay.mp4``. The size of the report is bounded. Memory
    grows only with the number of split-half tests.

    Parameters
    ----------
    folder : str or Path
        Output folder of ``farpoint run``.
    truth : str or Path, optional
        TUM, KITTI or EuRoC trajectory of the camera, drawn beside the path.

    Returns
    -------
    Path
        The report: one file that needs no network.

    Raises
    ------
    InputError
        If one of the files is missing or damaged, or the page cannot be written.
    """
    folder = Path(folder)
    run = read_run(folder / "run.json")
    digest = digest_motions(folder / "motions.csv")
    moments = digest.moments.found({item["frame1"]: item["reason"] for item in run["reasons"]})
    video, halves = folder / "overlay.mp4", folder / "halves.csv"
    page = PageContents(
        run=run,
        digest=digest,
        halves=read_halves(halves) if halves.is_file() else [],
        paths=paths_from_above(folder, None if truth is None else Path(truth)),
        moments=moments,
        stills=stills_at(video, [moment.time_s for moment in moments]),
        thumbs=thumbs_of(video, _THUMBS),
    )
    path = folder / REPORT_NAME
    with replacing(path) as part:
        part.write_text(render_page(page), encoding="utf-8", newline="\n")
    return path
