"""Files that are read whole: regular ones, up to a size, however they are named.

A FIFO or a device never ends, and a link may lead to one; what the system says of a file's size
need not hold for what is read from it.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

from farpoint.errors import InputError

__all__ = ["check_regular_file", "read_regular_file"]

# Opening a FIFO waits for a writer without it; Windows has neither.
_FLAGS = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
_CHUNK_BYTES = 1 << 20


def read_regular_file(path: Path, *, limit_bytes: int, what: str) -> bytes:
    """All bytes of a regular file.

    Parameters
    ----------
    path : Path
        Links are followed.
    limit_bytes : int
        More than that is an error.
    what : str
        What is expected there, such as ``"a calibration"``, for the message.

    Raises
    ------
    InputError
        If there is no such file, it is a folder, a device or a FIFO, too large, or cannot be read.
    """
    try:
        descriptor = os.open(path, _FLAGS)
    except OSError as error:
        raise _unreadable(path, error, what) from None
    try:
        _check_kind(path, os.fstat(descriptor).st_mode, what)
        file = os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise
    with file:
        chunks, left = [], limit_bytes
        try:
            while chunk := file.read(min(_CHUNK_BYTES, left + 1)):
                left -= len(chunk)
                if left < 0:
                    raise InputError(
                        f"is too large for {what}: more than {_size(limit_bytes)}", file=path
                    )
                chunks.append(chunk)
        except OSError as error:
            raise _unreadable(path, error, what) from None
    return b"".join(chunks)


def check_regular_file(path: Path, *, what: str) -> None:
    """Raise the InputError of `read_regular_file` where a path is no regular file, unopened."""
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
