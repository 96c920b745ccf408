"""Lock of an output folder, so that only one run at a time writes into the folder."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

from farpoint.errors import InputError
from farpoint.sinks.files import unwritable

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

__all__ = ["LOCK_NAME", "FolderLock"]

LOCK_NAME = ".farpoint.lock"

NO_LOCKS = (
    "the file system of the output folder has no locks: "
    "two runs into one folder at the same time would mix their files"
)

_LOCKED = {errno.EAGAIN, errno.EWOULDBLOCK, errno.EACCES, errno.EDEADLK}


class FolderLock:
    """Locks a folder until `release`; a missing folder is created.

    The operating system locks an open file and ends the lock with the process. Therefore the lock
    file of a killed run is not locked.

    Parameters
    ----------
    folder : Path
        The output folder.

    Raises
    ------
    InputError
        If another run has locked the folder, or if the folder cannot be written.

    Attributes
    ----------
    note : str or None
        A warning if the file system has no locks.
    """

    def __init__(self, folder: Path) -> None:
        self.note: str | None = None
        self._path = folder / LOCK_NAME
        self._made = not folder.exists()
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._file = self._hold(folder)
        except OSError as error:
            raise unwritable(folder, error) from error

    def release(self) -> None:
        """Unlock, and remove the lock file and an empty folder. A second call does nothing."""
        if self._file.closed:
            return
        if sys.platform == "win32":  # cannot remove an open file
            self._file.close()
        with contextlib.suppress(OSError):
            self._path.unlink()
            if self._made:
                self._path.parent.rmdir()  # fails if the folder is not empty
        # Closed last: after the unlock, the file at this path may be the lock of another run.
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.release()

    def _hold(self, folder: Path) -> BinaryIO:
        while True:
            file = self._path.open("ab", buffering=0)
            try:
                _lock(file.fileno())
            except OSError as error:
                if error.errno in _LOCKED:
                    file.close()
                    raise InputError(
                        "another run is writing into this folder", file=folder
                    ) from None
                self.note = NO_LOCKS
                return file
            if self._is_at_path(file):
                return file
            file.close()  # just removed by the previous run; another run may have made a new file

    def _is_at_path(self, file: BinaryIO) -> bool:
        if sys.platform == "win32":  # an open file stays at its path
            return True
        try:
            return os.path.samestat(os.fstat(file.fileno()), self._path.stat())
        except FileNotFoundError:
            return False


def _lock(descriptor: int) -> None:
    """Lock an open file without waiting, or raise an OSError."""
    if sys.platform == "win32":
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
    else:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
