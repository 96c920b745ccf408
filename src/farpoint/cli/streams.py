"""Standard streams that may be closed without ending the command."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import sys
from collections.abc import Iterator
from typing import TextIO

__all__ = ["lasting_streams"]


@contextlib.contextmanager
def lasting_streams() -> Iterator[None]:
    """Ignore writes to standard streams that nobody reads.

    A pipe whose reader has ended (``| head``), a closed stream (``>&-``) and a closed terminal then
    change neither the result nor the exit code of a command. Failed writes to standard error (a log
    on a full disk) are all ignored, because no results are written to standard error. Other failed
    writes to standard output raise an error.
    """
    _open_closed_descriptors()
    with (
        contextlib.redirect_stdout(_Lasting(sys.stdout)),  # type: ignore[type-var]
        contextlib.redirect_stderr(_Lasting(sys.stderr, has_results=False)),  # type: ignore[type-var]
    ):
        yield


def _open_closed_descriptors() -> None:
    """Open the null device for each of the descriptors 0 to 2 that is closed.

    Otherwise a file opened later would get such a descriptor, and printed text would go into that
    file.
    """
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDONLY if descriptor == 0 else os.O_WRONLY)  # lowest free


class _Lasting(io.TextIOBase):
    """A text stream that discards its text after its reader has ended, or if the stream is None.

    A stream without results also discards text after any other error.
    """

    def __init__(self, stream: TextIO | None, *, has_results: bool = True) -> None:
        self._stream, self._has_results = stream, has_results
        self._was_terminal = self.isatty()
        if isinstance(stream, io.TextIOWrapper):
            # Characters that the encoding of the terminal lacks are escaped and raise no error.
            stream.reconfigure(errors="backslashreplace")

    def write(self, text: str, /) -> int:
        with self._while_read() as stream:
            if stream is not None:
                stream.write(text)
        return len(text)

    def flush(self) -> None:
        with self._while_read() as stream:
            if stream is not None:
                stream.flush()

    def isatty(self) -> bool:
        stream = self._stream
        return stream is not None and not stream.closed and stream.isatty()

    def fileno(self) -> int:
        if self._stream is None:
            raise io.UnsupportedOperation("fileno")
        return self._stream.fileno()

    @contextlib.contextmanager
    def _while_read(self) -> Iterator[TextIO | None]:
        try:
            yield self._stream
        except OSError as error:
            # A terminal that hung up gives EIO.
            has_gone = isinstance(error, BrokenPipeError) or (
                self._was_terminal and error.errno == errno.EIO
            )
            if self._has_results and not has_gone:
                raise
            stream, self._stream = self._stream, None
            # Python must not try to write the rest of the buffer at exit.
            with contextlib.suppress(io.UnsupportedOperation, AttributeError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())  # type: ignore[union-attr]
