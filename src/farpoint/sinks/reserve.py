"""Reserved disk space for a file that must be written even if the disk is full."""

from __future__ import annotations

import contextlib
import errno
import os
from pathlib import Path

from farpoint.sinks.files import unwritable

__all__ = ["RESERVE_NAME", "Reserve"]

RESERVE_NAME = ".run.json.reserve"

_BYTES = 1 << 17  # more than a run.json with all the reasons that it may hold


class Reserve:
    """A file with reserved disk space, overwritten and renamed at the end.

    Parameters
    ----------
    path : Path
        The file for which the space is reserved.

    Raises
    ------
    InputError
        If the disk has too little free space.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._reserve = path.with_name(RESERVE_NAME)
        try:
            # No zeros: file systems that compress would reserve nothing.
            self._reserve.write_bytes(os.urandom(_BYTES))
        except OSError as error:
            self.release()
            if error.errno != errno.EFBIG:  # a limit of file sizes, not of the disk
                raise unwritable(path, error) from error

    def replace(self, text: str) -> bool:
        """Replace the file by a text in the reserved space; returns False if writing failed."""
        try:
            with self._reserve.open("r+b") as file:
                file.write(text.encode())
                file.truncate()
            self._reserve.replace(self._path)
        except OSError:
            return False
        return True

    def release(self) -> None:
        """Free the reserved space; a second call does nothing."""
        with contextlib.suppress(OSError):
            self._reserve.unlink(missing_ok=True)
