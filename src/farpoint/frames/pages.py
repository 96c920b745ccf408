"""Image files with several pages. Each page is a frame."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from farpoint.errors import optional_import
from farpoint.regular_files import check_regular_file

__all__ = ["image_size", "pages_of", "read_page", "with_pages"]

_OF_PAGES = frozenset({".tif", ".tiff", ".webp"})
_GREY_MODES = ("L", "I;16", "I;16B", "I;16L")


def with_pages(images: Sequence[Path]) -> tuple[tuple[Path, ...], tuple[int, ...]]:
    """For each page of the images, in order, the file and the number of the page in the file.

    An unreadable file counts as one page, which becomes a frame with a fault.
    """
    pages = [(image, page) for image in images for page in range(pages_of(image))]
    return tuple(image for image, _ in pages), tuple(page for _, page in pages)


def pages_of(path: Path) -> int:
    """Number of pages of an image file; 1 if the number is unknown."""
    if path.suffix.lower() not in _OF_PAGES:
        return 1
    try:
        check_regular_file(path, what="an image")
        with _opened(path) as image:
            return getattr(image, "n_frames", 1)
    except Exception:  # Pillow raises many kinds of errors for damaged files
        return 1


def read_page(path: Path, page: int) -> np.ndarray:
    """Grey values of a page (H, W), uint8, or uint16 for more than 8 bits.

    Raises OSError if the page is damaged.
    """
    with _opened(path) as image:
        image.seek(page)
        if image.mode not in _GREY_MODES:
            image = image.convert("L")
        samples = np.asarray(image)
        return samples.astype(np.uint16) if samples.dtype.itemsize == 2 else samples


def image_size(data: bytes) -> tuple[int, int] | None:
    """Width and height of an image from the header in the bytes of the file; None if missing.

    For an image that Pillow refuses as too large, the result is (number of pixels, 1).
    """
    Image = _pillow()
    try:
        with _opened(io.BytesIO(data)) as image:
            return image.size
    except Image.DecompressionBombError as error:
        pixels = int("".join(filter(str.isdigit, str(error).partition("pixels")[0])) or 0)
        return pixels, 1
    except Exception:  # Pillow raises many kinds of errors for damaged files
        return None


def _pillow() -> Any:
    return optional_import("PIL.Image", extra="video", purpose="reading images")


@contextmanager
def _opened(file: Path | io.BytesIO) -> Iterator[Any]:
    """An image opened by Pillow. Warnings of damage and size are suppressed."""
    Image = _pillow()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with Image.open(file) as image:
            yield image
