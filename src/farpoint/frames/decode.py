"""From an image file to grey values."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from farpoint.errors import InputError, optional_import
from farpoint.frames.depth import GreyTable
from farpoint.frames.integrity import find_damage
from farpoint.frames.pages import image_size
from farpoint.regular_files import read_regular_file

__all__ = [
    "MAX_MEGAPIXELS",
    "UnreadableImageError",
    "read_grey",
    "read_samples",
    "silent_opencv",
]


MAX_MEGAPIXELS = 100.0
"""Default limit: twice the largest cameras of today, and half a gigabyte to decode (convention)."""

_LARGEST_BYTES = 1 << 30
_SILENT = 0


class UnreadableImageError(Exception):
    """One image cannot be had; the message says why. Never leaves this package."""


def read_grey(
    path: Path, deep: GreyTable | None = None, max_megapixels: float = MAX_MEGAPIXELS
) -> np.ndarray:
    """Grey values of an image file, uint8 of shape (height, width).

    Colour becomes OpenCV's luma; an EXIF orientation is applied.

    Parameters
    ----------
    path : Path
        The file.
    deep : GreyTable, optional
        What 16 bits become; their upper 8 by default.
    max_megapixels : float
        Larger images are not decoded.

    Raises
    ------
    UnreadableImageError
        Where the file cannot be read, is incomplete, too large, or is no image.
    """
    image = read_samples(path, max_megapixels)
    if image.dtype == np.uint16:
        return (deep or GreyTable.upper_bits(16))(image)
    return image


def read_samples(path: Path, max_megapixels: float = MAX_MEGAPIXELS) -> np.ndarray:
    """As `read_grey`, with 16 bits as they are, uint16."""
    cv2 = optional_import("cv2", extra="video", purpose="reading images")
    try:
        # Read by Python: OpenCV opens no path outside the code page on Windows.
        data = read_regular_file(path, limit_bytes=_LARGEST_BYTES, what="an image")
    except InputError as error:
        raise UnreadableImageError(error.problem) from error
    if damage := find_damage(data):
        raise UnreadableImageError(damage)
    size = image_size(data)
    if size is not None and size[0] * size[1] > max_megapixels * 1e6:
        megapixels = size[0] * size[1] / 1e6
        raise UnreadableImageError(
            f"has {megapixels:.0f} megapixels; expected {max_megapixels:g} at most "
            "(--max-megapixels)"
        )
    with silent_opencv():
        samples = np.frombuffer(data, np.uint8)
        try:
            image = cv2.imdecode(samples, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH)
            if image is not None and image.dtype not in (np.uint8, np.uint16):
                image = cv2.imdecode(samples, cv2.IMREAD_GRAYSCALE)
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
