"""From an image file to grey values."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from farpoint.errors import optional_import
from farpoint.frames.integrity import find_damage

__all__ = ["UnreadableImageError", "read_grey", "silent_opencv"]


_SILENT = 0


class UnreadableImageError(Exception):
    """One image cannot be had; the message says why. Never leaves this package."""


def read_grey(path: Path) -> np.ndarray:
    """Grey values of an image file, uint8 of shape (height, width).

    Colour becomes OpenCV's luma; 16 bits keep their upper 8; an EXIF orientation is applied.

    Raises
    ------
    UnreadableImageError
        Where the file cannot be read, is incomplete, or is no image.
    """
    cv2 = optional_import("cv2", extra="video", purpose="reading images")
    try:
        # Read by Python: OpenCV opens no path outside the code page on Windows.
        data = path.read_bytes()
    except OSError as error:
        raise UnreadableImageError(f"cannot be read: {error.strerror}") from error
    if damage := find_damage(data):
        raise UnreadableImageError(damage)
    with silent_opencv():
        try:
            image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
        except cv2.error:  # raised for absurd sizes, instead of returning None
            image = None
    if image is None:
        raise UnreadableImageError("cannot be decoded as an image")
    return image


@contextmanager
def silent_opencv() -> Iterator[None]:
    """Keep OpenCV's warnings off stderr: what they tell is told by a fault or an InputError."""
    cv2 = optional_import("cv2", extra="video", purpose="reading images")
    logging = getattr(cv2.utils, "logging", cv2)  # where OpenCV before 4.13 has its functions
    level = logging.setLogLevel(_SILENT)
    try:
        yield
    finally:
        logging.setLogLevel(level)
