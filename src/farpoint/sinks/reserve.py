"""Room on the disk for what must be written even when the disk is full."""

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
    """A file whose space on the disk is there, to be written over and renamed at the end.

    Parameters
    ----------
    path : Path
        The file that it is kept for.

    Raises
    ------
    InputError
        If there is no room for it.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._reserve = path.with_name(RESERVE_NAME)
        try:
            # No zeros: file systems that compress would reserve nothing.
            self._reserve.write_bytes(os.urandom(_BYTES))
        except OSError as error:
            self.release()
            if error.errno != errno.EFBIG:  # a limit of each file's size is not one of the disk
                raise unwritable(path, error) from error

    def replace(self, text: str) -> bool:
        """Put a text in place of the file that the room is kept for; whether that went well."""
        try:
            with self._reserve.open("r+b") as file:
                file.write(text.encode())
                file.truncate()
            self._reserve.replace(self._path)
        except OSError:
            return False
        return True

    def release(self) -> None:
        """Give the room back; a second call does nothing."""
        with contextlib.suppress(OSError):
            self._reserve.unlink(missing_ok=True)
