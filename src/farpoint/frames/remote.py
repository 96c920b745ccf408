"""Sources in object stores and on other file systems, opened by fsspec."""

from __future__ import annotations

import re
import tempfile
import weakref
from collections.abc import Callable
from functools import partial
from pathlib import Path, PurePosixPath
from types import TracebackType
from typing import IO, Any, Self

from farpoint.errors import InputError, optional_import
from farpoint.frames.bags import is_bag_file
from farpoint.frames.frame import FrameSource
from farpoint.frames.video import open_video

__all__ = ["is_remote", "open_remote", "open_remote_file", "remote_place"]

_STREAMS = ("rtsp", "rtsps", "rtmp", "http", "https", "udp", "tcp", "rtp", "srt")


def is_remote(source: str) -> bool:
    """Whether fsspec reads the URL.

    fsspec reads schemes that FFmpeg does not know, and web folders (with a final ``/``) and bags.
    """
    scheme, mark, rest = source.partition("://")
    if not mark:
        return False
    if scheme.lower() in ("http", "https"):
        return rest.endswith("/") or is_bag_file(rest.partition("?")[0])
    return scheme.lower() not in _STREAMS


def remote_place(url: str) -> tuple[Any, str]:
    """The file system of a URL, and the path in this file system.

    Raises
    ------
    InputError
        If the scheme is unknown to fsspec.
    MissingExtraError
        If fsspec, or a library that fsspec needs for this scheme, is not installed.
    """
    fsspec = optional_import("fsspec", extra="remote", purpose="reading from other file systems")
    try:
        return fsspec.core.url_to_fs(url)
    except ValueError as error:
        raise InputError(f"unknown kind of stream or store ({error})", file=_public(url)) from None
    except ImportError as error:
        raise _unreadable(url, error) from None


def open_remote_file(url: str) -> IO[bytes]:
    """Open a file at a URL; only the requested ranges are read.

    Raises
    ------
    InputError
        If the file does not exist or cannot be read.
    """
    system, path = remote_place(url)
    try:
        return system.open(path, "rb")
    except Exception as error:  # each file system has errors of its own
        raise _unreadable(url, error) from None


def open_remote(
    url: str,
    open_local: Callable[[Path], FrameSource],
    *,
    fps: float | None,
    follow_playlists: bool = False,
) -> FrameSource:
    """Open a remote source. A video is read during decoding; a folder or bag is copied first.

    Parameters
    ----------
    url : str
        URL, such as ``"s3://bucket/drive.mp4"``.
    open_local : callable
        Opens a folder or bag on this machine. The copy is deleted together with the returned
        source.
    fps : float or None
        Frames per second of a video without time stamps.
    follow_playlists : bool
        Open the files that are named in a playlist.

    Raises
    ------
    InputError
        If the source is missing or unreadable, or has no pictures.
    """
    system, path = remote_place(url)
    name = PurePosixPath(path.rstrip("/")).name
    try:
        if system.isdir(path):
            return _copied(system, path, name, open_local)
        if not system.exists(path):
            raise InputError("no such file or folder")
        if is_bag_file(name):
            return _copied(system, path, name, open_local)
        opener: Any = partial(_Steady, url)  # has read, seek and tell, which is enough for PyAV
        return open_video(Path(name), fps=fps, follow_playlists=follow_playlists, opener=opener)
    except InputError as error:
        raise InputError(error.problem, file=_public(url)) from None
    except Exception as error:  # each file system has errors of its own
        raise _unreadable(url, error) from None


class _Steady:
    """A remote file that ends if the connection breaks, and raises the error on closing.

    The error waits because FFmpeg does not pass on Python errors during a read.
    """

    def __init__(self, url: str) -> None:
        self._url, self._file = url, open_remote_file(url)
        self._error: Exception | None = None
        self.seek, self.tell = self._file.seek, self._file.tell

    def read(self, size: int = -1) -> bytes:
        """Read ``size`` bytes, or fewer at the end of the file."""
        try:
            return self._file.read(size)
        except Exception as error:  # each file system has errors of its own
            self._error = error
            return b""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()
        if self._error is not None and (error is None or isinstance(error, Exception)):
            raise _unreadable(self._url, self._error) from None


def _copied(
    system: Any, path: str, name: str, open_local: Callable[[Path], FrameSource]
) -> FrameSource:
    place = tempfile.TemporaryDirectory(prefix="farpoint-")
    copy = Path(place.name) / (name or "images")
    try:
        if is_bag_file(name):
            system.get_file(path, str(copy))
        else:
            _copy_folder(system, path, copy)
        opened = open_local(copy)
    except BaseException:
        place.cleanup()
        raise
    weakref.finalize(opened, place.cleanup)
    return opened


def _copy_folder(system: Any, path: str, folder: Path) -> None:
    folder.mkdir()
    for file in system.find(path):
        within = PurePosixPath(file.removeprefix(path.rstrip("/")).lstrip("/"))
        if file.endswith("/") or ".." in within.parts:  # names from the server may leave the folder
            continue
        copy = folder / within
        copy.parent.mkdir(parents=True, exist_ok=True)
        system.get_file(file, str(copy))


def _unreadable(url: str, error: Exception) -> InputError:
    words = " ".join(str(error).replace(url, _public(url)).split()) or type(error).__name__
    return InputError(f"cannot be read: {words}", file=_public(url))


def _public(url: str) -> str:
    """The URL without passwords and tokens."""
    return re.sub(r"//[^/]*@", "//", url.partition("?")[0])
