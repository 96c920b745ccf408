"""Search for images on disk, in natural order."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from pathlib import Path

from farpoint.errors import InputError
from farpoint.frames.clock import seconds_in_name
from farpoint.regular_files import regular_lines

__all__ = ["in_order", "is_image", "list_images", "natural_key", "read_lines", "source_name"]

_IMAGE_SUFFIXES = frozenset(
    {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".pnm", ".webp"}
)

_LARGEST_LIST_BYTES = 1 << 28
_MOST_LINES = 2_000_000  # 18 hours at 30 a second
"""Largest number of lines of a file that lists images or times (convention)."""

_NO_NAMES = frozenset(
    {"images", "image", "imgs", "img", "frames", "rgb", "color", "colour", "gray", "grey"}
    | {"data", "undistorted", "mav0", "cam0", "image_0", "image_00", "left"}
)
_OTHER_CAMERA = re.compile(r"(?:cam|image_)[0-9]+|right")


def natural_key(name: str) -> tuple[list[str | int], str]:
    """Sort key in which numbers count as numbers: ``img2`` comes before ``img10``."""
    # Splitting at a group of digits puts text at even and digits at odd places, so that keys of
    # any two names compare text with text and number with number.
    parts = re.split(r"([0-9]+)", name)
    return [int(part) if i % 2 else part.casefold() for i, part in enumerate(parts)], name


def in_order(images: Iterable[Path]) -> list[Path]:
    """Images in order of time if every name is a time stamp, otherwise in natural order."""
    stamped = [(seconds_in_name(image), image) for image in images]
    by_time = [(seconds, image) for seconds, image in stamped if seconds is not None]
    if len(by_time) == len(stamped):
        return [image for _, image in sorted(by_time)]
    return sorted((image for _, image in stamped), key=lambda image: natural_key(str(image)))


def is_image(path: str | Path) -> bool:
    """Whether a name is that of an image; hidden files (macOS's ``._1.png``) do not count."""
    path = Path(path)
    return path.suffix.lower() in _IMAGE_SUFFIXES and not path.name.startswith(".")


def list_images(folder: Path) -> list[Path]:
    """Images directly in `folder`, in order; empty if there is no such folder.

    Broken links are listed, too. Each broken link becomes a frame with a fault, because an image is
    missing there.
    """
    try:
        with os.scandir(folder) as entries:
            names = [entry.name for entry in entries if is_image(entry.name) and not entry.is_dir()]
    except (FileNotFoundError, NotADirectoryError):
        return []
    return in_order(folder / name for name in names)


def read_lines(path: Path) -> list[tuple[int, str]]:
    """Number (from 1) and text of every line that is neither blank nor a ``#`` comment."""
    lines = []
    for number, text in enumerate(
        regular_lines(path, limit_bytes=_LARGEST_LIST_BYTES, what="a list"), start=1
    ):
        if (line := text.strip()) and not line.startswith("#"):
            lines.append((number, line))
            if len(lines) > _MOST_LINES:
                raise InputError(f"expected a list of at most {_MOST_LINES} lines", file=path)
    return lines


def source_name(folder: Path) -> str:
    """Name of the sequence whose images are in `folder`.

    Many datasets use the same names for the folders of the images. Therefore the name for
    ``drive/images`` and for ``drive/mav0/cam0/data`` is ``drive``: opening ``drive`` reads the same
    images. The name for a folder of another camera includes the camera: ``drive-cam1``.
    """
    folder = folder.resolve()
    if not folder.name:
        return ""
    if folder.name.lower() in _NO_NAMES:
        return source_name(folder.parent) or folder.name
    if _OTHER_CAMERA.fullmatch(folder.name.lower()):
        return "-".join(part for part in (source_name(folder.parent), folder.name) if part)
    return folder.name
