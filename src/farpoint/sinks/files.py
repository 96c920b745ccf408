"""Output files. Each piece is written to a file completely or not at all."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Self

from farpoint.errors import InputError

__all__ = [
    "AppendFile",
    "check_writable",
    "new_of",
    "part_of",
    "replacing",
    "text_output",
    "unwritable",
]


class AppendFile:
    """A file that grows by whole pieces, which are written in order without a buffer.

    If a piece does not fit on the disk, that piece is removed from the file, and earlier pieces
    stay. The file is created together with the first piece.

    Parameters
    ----------
    path : Path
        The file; an existing file is replaced.
    first : bytes
        The first piece.

    Raises
    ------
    InputError
        If the file cannot be written, also by `append`.
    """

    def __init__(self, path: Path, first: bytes) -> None:
        self._path = path
        with replacing(path, new_of(path)) as new:
            new.write_bytes(first)
        self._size = len(first)
        try:
            self._file = path.open("ab", buffering=0)
        except OSError as error:
            raise unwritable(path, error) from error

    def append(self, piece: bytes) -> None:
        """Add a piece. If the process is killed afterwards, the piece is not lost."""
        try:
            rest = memoryview(piece)
            while rest:
                rest = rest[self._file.write(rest) :]
        except OSError as error:
            with contextlib.suppress(OSError):
                self._file.truncate(self._size)
            raise unwritable(self._path, error) from error
        self._size += len(piece)

    def is_at_its_path(self) -> bool:
        """Whether the open file is still at ``path``: another run may have replaced the file."""
        with contextlib.suppress(OSError):
            return os.fstat(self._file.fileno()).st_ino == self._path.stat().st_ino
        return False

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        try:
            self._file.close()
        except OSError as error:  # network file systems report a full disk here
            raise unwritable(self._path, error) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


@contextmanager
def replacing(path: Path, part: Path | None = None) -> Iterator[Path]:
    """A temporary file beside ``path``, renamed to ``path`` if the block ends without an error.

    Parameters
    ----------
    path : Path
        The file; an existing file is replaced.
    part : Path, optional
        The temporary file; `part_of` the path by default.

    Raises
    ------
    InputError
        If writing fails; ``path`` is then unchanged.
    """
    part = part or part_of(path)
    try:
        yield part
        part.replace(path)
    except OSError as error:
        raise unwritable(path, error) from error
    finally:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)


def part_of(path: Path) -> Path:
    """The temporary file of ``path``."""
    return path.with_name(path.name + ".part")


def new_of(path: Path) -> Path:
    """The temporary file of the first piece of ``path``, distinct from `part_of` the path."""
    return path.with_name(path.name + ".new")


@contextmanager
def text_output(path: Path, part: Path) -> Iterator[Callable[[str], None]]:
    """Write text into ``part``, the temporary file of ``path``; errors name ``path``."""

    def write(text: str) -> None:
        try:
            file.write(text)
        except OSError as error:
            raise unwritable(path, error) from error

    try:
        with part.open("w", encoding="utf-8", newline="\n") as file:
            yield write
    except OSError as error:  # a full disk may be reported only when the file is closed
        raise unwritable(path, error) from error


def check_writable(path: Path) -> None:
    """Raise an InputError if a file cannot be written; a missing file stays missing."""
    there = path.exists()
    try:
        path.open("ab").close()
        if not there:
            path.unlink()
    except OSError as error:
        raise unwritable(path, error) from error


def unwritable(path: Path, error: OSError) -> InputError:
    """The error that names a file and the reason why it cannot be written."""
    return InputError(f"cannot be written: {error.strerror or error}", file=path)
