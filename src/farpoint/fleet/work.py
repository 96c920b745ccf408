"""Task of a worker: run one drive into a folder, unless the drive is finished."""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from farpoint.errors import InputError, MissingExtraError, optional_import, printable
from farpoint.fleet.drive import Drive
from farpoint.fleet.folder import finish_folder, is_finished
from farpoint.fleet.table import facts_of_run

__all__ = ["Work", "do_drive", "one_line"]


@dataclass(frozen=True, kw_only=True)
class Work:
    """A drive, its folder, and the key that identifies a finished drive."""

    drive: Drive
    folder: Path
    key: str


def do_drive(work: Work) -> str | None:
    """Run a drive that is not finished; returns the reason of a failure in one line, or None."""
    if is_finished(work.folder, work.key):  # by a worker that died before it returned
        return None
    try:
        optional_import("cv2", extra="video", purpose="reading images").setNumThreads(1)
        output = io.StringIO()
        with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
            finish_folder(work.folder, work.key, partial(_run, work.drive))
    except Exception as error:  # any error: the other drives go on
        return one_line(error)
    return None


def _run(drive: Drive, folder: Path) -> dict[str, Any]:
    drive.run(folder)
    return facts_of_run(folder)


def one_line(error: BaseException) -> str:
    """The text of an error in one line, for the table."""
    if isinstance(error, InputError | MissingExtraError):
        return printable(str(error))
    return printable(f"{type(error).__name__}: {error}"[:500])
