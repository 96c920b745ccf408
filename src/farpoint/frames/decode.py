"""Decoding of image files to grey values."""

from __future__ import annotations

import os
import re
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from farpoint.errors import InputError, optional_import
from farpoint.frames.depth import GreyTable
from farpoint.frames.integrity import JPEG_START, find_damage
from farpoint.frames.pages import image_size
from farpoint.regular_files import read_regular_file

__all__ = [
    "MAX_MEGAPIXELS",
    "UnreadableImageError",
    "check_megapixels",
    "decode_samples",
    "read_grey",
    "read_samples",
    "silent_opencv",
]


MAX_MEGAPIXELS = 100.0
"""Default limit: twice the largest cameras of today, and half a gigabyte to decode (convention)."""

_LARGEST_BYTES = 1 << 30
_SILENT, _STDERR = 0, 2
_LONGEST_WORDS = 1 << 16
# Messages of libjpeg about data that it replaced by a guess. Extra bytes before the end marker,
# which many cameras write, are no damage.
_JPEG_DAMAGE = re.compile(
    rb"Corrupt JPEG data: (?!\d+ extraneous bytes before marker 0xd9)"
    rb"|Premature end of JPEG file|Inconsistent progression sequence"
)


class UnreadableImageError(Exception):
    """Error: one image is unreadable. The message has the cause. The package catches this error."""


def read_grey(
    path: Path, deep: GreyTable | None = None, max_megapixels: float = MAX_MEGAPIXELS
) -> np.ndarray:
    """Grey values of an image file, uint8 of shape (height, width).

    Colour is converted to OpenCV's luma, and an EXIF orientation is applied.

    Parameters
    ----------
    path : Path
        The file.
    deep : GreyTable, optional
        Mapping of 16-bit samples to grey values. By default the upper 8 bits are used.
    max_megapixels : float
        Larger images are not decoded.

    Raises
    ------
    UnreadableImageError
        If the file cannot be read, is incomplete, is too large, or is no image.
    """
    image = read_samples(path, max_megapixels)
    if image.dtype == np.uint16:
        return (deep or GreyTable.upper_bits(16))(image)
    return image


def read_samples(path: Path, max_megapixels: float = MAX_MEGAPIXELS) -> np.ndarray:
    """Like `read_grey`, but 16-bit samples stay uint16."""
    try:
        # Read by Python: OpenCV opens no path outside the code page on Windows.
        data = read_regular_file(path, limit_bytes=_LARGEST_BYTES, what="an image")
    except InputError as error:
        raise UnreadableImageError(error.problem) from error
    return decode_samples(data, max_megapixels)


def decode_samples(data: bytes, max_megapixels: float = MAX_MEGAPIXELS) -> np.ndarray:
    """Like `read_samples`, from the bytes of an image file."""
    cv2 = optional_import("cv2", extra="video", purpose="reading images")
    if damage := find_damage(data):
        raise UnreadableImageError(damage)
    if (size := image_size(data)) is not None:
        check_megapixels(*size, max_megapixels)
    with silent_opencv(), _silent_codecs as messages:
        samples = np.frombuffer(data, np.uint8)
        try:
            image = cv2.imdecode(samples, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH)
            if image is not None and image.dtype not in (np.uint8, np.uint16):
                image = cv2.imdecode(samples, cv2.IMREAD_GRAYSCALE)
        except cv2.error:  # raised for absurd sizes, instead of returning None
            image = None
        if data.startswith(JPEG_START) and _JPEG_DAMAGE.search(messages()):
            raise UnreadableImageError("the JPEG is damaged: a part of it is not what was seen")
    if image is None:
        raise UnreadableImageError("cannot be decoded as an image")
    return image


def check_megapixels(width: int, height: int, limit: float) -> None:
    """Raise UnreadableImageError if an image has more than ``limit`` million pixels."""
    if width * height > limit * 1e6:
        raise UnreadableImageError(
            f"has {width * height / 1e6:.0f} megapixels; expected {limit:g} at most "
            "(--max-megapixels)"
        )


@contextmanager
def silent_opencv() -> Iterator[None]:
    """Suppress OpenCV's warnings on stderr; a fault or an InputError replaces these warnings."""
    cv2 = optional_import("cv2", extra="video", purpose="reading images")
    logging = getattr(cv2.utils, "logging", cv2)  # where OpenCV before 4.13 has its functions
    level = logging.setLogLevel(_SILENT)
    try:
        yield
    finally:
        logging.setLogLevel(level)


class _SilentCodecs:
    """Redirection of standard error to a file, for libraries that report errors only on stderr.

    Python's own messages are redirected, too. Only one thread at a time may redirect, so that all
    messages belong to the current image.
    """

    def __init__(self) -> None:
        self._lock, self._saved = threading.RLock(), -1

    def __enter__(self) -> Callable[[], bytes]:
        self._lock.acquire()
        self._file = tempfile.TemporaryFile()
        self._saved = _replace_stderr(self._file.fileno())
        return self._messages

    def _messages(self) -> bytes:
        """The redirected messages so far."""
        self._file.seek(0)
        return self._file.read(_LONGEST_WORDS)

    def __exit__(self, *error: object) -> None:
        if self._saved >= 0:
            os.dup2(self._saved, _STDERR)
            os.close(self._saved)
        self._file.close()
        self._lock.release()


_silent_codecs = _SilentCodecs()


def _replace_stderr(descriptor: int) -> int:
    """Replace standard error by a file; returns a copy of the old descriptor, or -1 if closed."""
    try:
        saved = os.dup(_STDERR)
    except OSError:
        return -1
    os.dup2(descriptor, _STDERR)
    return saved
