"""Reading of regular files up to a size limit. FIFOs, devices and folders are refused.

A FIFO or a device can deliver bytes without end. The size in the metadata of a file can be wrong,
so the limit applies to the count of the bytes that are read.
"""

from __future__ import annotations

import codecs
import io
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from farpoint.errors import InputError

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

__all__ = ["check_regular_file", "open_regular_file", "read_regular_file", "regular_lines"]

# Without O_NONBLOCK, opening a FIFO waits for a writer. Windows has no FIFOs and no O_NONBLOCK.
_FLAGS = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
_LONGEST_LINE = 1 << 16
_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


@contextmanager
def open_regular_file(
    path: Path, *, limit_bytes: int, what: str
) -> Iterator[io.BufferedReader[_UpTo]]:
    """Open a regular file for reading, up to a number of bytes.

    Parameters
    ----------
    path : Path
        Path of the file. Symbolic links are followed.
    limit_bytes : int
        Largest number of bytes. Reading more bytes raises an InputError, even if the metadata of
        the file state a smaller size.
    what : str
        The expected content, such as ``"a calibration"``, for the message.

    Raises
    ------
    InputError
        If the file is absent, a folder, a device, a FIFO, too large or unreadable. The error can
        also occur within the ``with`` block, while the file is read.
    """
    try:
        descriptor = os.open(path, _FLAGS)
    except OSError as error:
        raise _unreadable(path, error, what) from None
    except ValueError:  # a NUL in the name
        raise InputError(f"no such file; expected {what}", file=path) from None
    try:
        _check_kind(path, os.fstat(descriptor).st_mode, what)
        with io.BufferedReader(_UpTo(descriptor, path, limit_bytes, what)) as file:
            yield file
    finally:
        os.close(descriptor)


def read_regular_file(path: Path, *, limit_bytes: int, what: str) -> bytes:
    """All bytes of a regular file. Parameters and errors are those of `open_regular_file`."""
    with open_regular_file(path, limit_bytes=limit_bytes, what=what) as file:
        return file.read()


def regular_lines(
    path: Path, *, limit_bytes: int, what: str, newline: str | None = None
) -> Iterator[str]:
    """Lines of a regular text file, with their line ends.

    The text is UTF-8, or UTF-16 with a byte order mark. Parameters and errors are those of
    `open_regular_file`, and ``newline`` is that of `open`. Binary content, or a line of more than
    65,536 characters, raises an InputError, too.
    """
    with open_regular_file(path, limit_bytes=limit_bytes, what=what) as file:
        encoding = "utf-16" if file.peek(2)[:2] in _UTF_16 else "utf-8-sig"
        text = io.TextIOWrapper(file, encoding=encoding, newline=newline)
        number = 0
        try:
            while line := text.readline(_LONGEST_LINE + 1):
                number += 1
                if len(line) > _LONGEST_LINE:
                    raise InputError(
                        f"expected {what}, got a line of more than {_LONGEST_LINE} characters",
                        file=path,
                        field=f"line {number}",
                    )
                yield line
        except UnicodeError:
            raise InputError(f"expected {what}, a text file", file=path) from None


class _UpTo(io.RawIOBase):
    """Stream of a file's bytes that raises an InputError beyond the limit, or if reading fails."""

    def __init__(self, descriptor: int, path: Path, limit_bytes: int, what: str) -> None:
        self._descriptor, self._path, self._what = descriptor, path, what
        self._limit_bytes = self._remaining = limit_bytes

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: WriteableBuffer, /) -> int:
        """Fill a buffer and count the bytes. The method raises an InputError beyond the limit."""
        # One byte beyond the limit shows whether the file ends there.
        view = memoryview(buffer)[: self._remaining + 1]
        try:
            data = os.read(self._descriptor, len(view))
        except OSError as error:
            raise _unreadable(self._path, error, self._what) from None
        view[: len(data)] = data
        self._remaining -= len(data)
        if self._remaining < 0:
            raise InputError(
                f"is too large for {self._what}: more than {_size(self._limit_bytes)}",
                file=self._path,
            )
        return len(data)


def check_regular_file(path: Path, *, what: str) -> None:
    """Raise the InputError of `read_regular_file` if a path is no regular file.

    The file is not opened.
    """
    try:
        mode = path.stat().st_mode
    except OSError as error:
        raise _unreadable(path, error, what) from None
    except ValueError:  # a NUL in the name
        raise InputError(f"no such file; expected {what}", file=path) from None
    _check_kind(path, mode, what)


def _check_kind(path: Path, mode: int, what: str) -> None:
    if stat.S_ISDIR(mode):
        raise InputError(f"is a folder; expected {what}", file=path)
    if not stat.S_ISREG(mode):
        raise InputError(f"is no regular file; expected {what}", file=path)


def _unreadable(path: Path, error: OSError, what: str) -> InputError:
    if isinstance(error, FileNotFoundError):
        return InputError(f"no such file; expected {what}", file=path)
    if isinstance(error, IsADirectoryError) or path.is_dir():
        return InputError(f"is a folder; expected {what}", file=path)
    return InputError(f"cannot be read: {error.strerror}", file=path)


def _size(limit_bytes: int) -> str:
    return f"{limit_bytes >> 20} MB" if limit_bytes >= 1 << 20 else f"{limit_bytes >> 10} kB"
