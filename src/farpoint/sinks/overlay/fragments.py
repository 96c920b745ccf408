"""File of a fragmented MP4 video, which contains complete fragments only."""

from __future__ import annotations

import contextlib
from pathlib import Path

from farpoint.errors import InputError
from farpoint.sinks.files import AppendFile

__all__ = ["FragmentFile"]

_SIZE, _HEADER, _LONG_HEADER = 4, 8, 16  # bytes
_LAST_OF_FRAGMENT = b"mdat"


class FragmentFile:
    """File that receives an MP4 from PyAV in pieces of any size, and stores whole fragments.

    The file is created together with the first fragment. If a fragment cannot be written, the file
    ends before that fragment, and the earlier fragments can be played. `raise_problem` raises the
    cause.

    Parameters
    ----------
    path : Path
        The file; an existing file is replaced.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: AppendFile | None = None
        self._waiting = bytearray()  # boxes (ISO/IEC 14496-12) up to the end of a fragment
        self._next = 0  # offset of the next box in _waiting
        self._ended = False
        self._problem: InputError | None = None
        self._identity: tuple[int, ...] | None = None

    def write(self, data: bytes) -> int:
        """Add a piece. The method raises no error, because FFmpeg calls it; see `raise_problem`."""
        if not self._ended:
            self._waiting += data
            while not self._ended and (kind := self._skip_box()) is not None:
                if kind == _LAST_OF_FRAGMENT:
                    self._add_waiting()
        return len(data)

    def raise_problem(self) -> None:
        """Raise, once, the InputError that ended the file."""
        problem, self._problem = self._problem, None
        if problem is not None:
            raise problem

    def close(self) -> None:
        """Add the data after the last fragment, and close the file."""
        if self._file is None:
            return
        if not self._ended and self._next == len(self._waiting):  # no box is cut
            self._add_waiting()
        self._ended = True
        at_its_path = self._file.is_at_its_path()
        self._file.close()
        self._identity = _identity(self._path) if at_its_path else None

    def is_at_its_path(self) -> bool:
        """Whether the closed file is still at ``path``: a later run may have replaced the file."""
        return self._identity is not None and self._identity == _identity(self._path)

    def _skip_box(self) -> bytes | None:
        """Skip the next box of the MP4 and return its type; None if the box is incomplete."""
        header = self._waiting[self._next : self._next + _LONG_HEADER]
        size = int.from_bytes(header[:_SIZE], "big")
        if size == 1:  # the true size follows the type
            size = int.from_bytes(header[_HEADER:], "big") if len(header) == _LONG_HEADER else 0
        if size < _HEADER or self._next + size > len(self._waiting):
            return None
        self._next += size
        return bytes(header[_SIZE:_HEADER])

    def _add_waiting(self) -> None:
        fragment = bytes(self._waiting[: self._next])
        try:
            if self._file is None:
                self._file = AppendFile(self._path, fragment)
            else:
                self._file.append(fragment)
        except InputError as problem:
            self._problem, self._ended = problem, True
            return
        del self._waiting[: self._next]
        self._next = 0


def _identity(path: Path) -> tuple[int, ...] | None:
    with contextlib.suppress(OSError):
        facts = path.stat()
        return facts.st_dev, facts.st_ino, facts.st_size, facts.st_mtime_ns
    return None
