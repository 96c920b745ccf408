"""Sequences of image files with time stamps."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from farpoint.errors import optional_import
from farpoint.frames.decode import MAX_MEGAPIXELS, UnreadableImageError, read_samples
from farpoint.frames.depth import EXAMPLES, GreyTable
from farpoint.frames.frame import Frame
from farpoint.frames.pages import read_page
from farpoint.frames.stamps import Stamps

__all__ = ["ImageSequence"]


@dataclass(frozen=True, kw_only=True)
class ImageSequence:
    """Image files in order, decoded one at a time. The object can be iterated repeatedly.

    Attributes
    ----------
    name : str
        Short name of the source.
    images : tuple of Path
        The files, in order.
    stamps : Stamps
        Times of the images.
    calibration_path : Path or None
        A file near the images that may be a calibration.
    pages : tuple of int
        Page of each image in its file; empty if all files have one page.
    max_megapixels : float
        Size limit of an image. A larger image is a frame with a fault.
    """

    name: str
    images: tuple[Path, ...]
    stamps: Stamps
    calibration_path: Path | None = None
    pages: tuple[int, ...] = ()
    max_megapixels: float = MAX_MEGAPIXELS

    def __post_init__(self) -> None:
        optional_import("cv2", extra="video", purpose="reading images")  # before the run starts

    @property
    def count(self) -> int:
        """Number of images."""
        return len(self.images)

    @property
    def timestamp_source(self) -> str:
        """Origin of the time stamps."""
        return self.stamps.source

    @property
    def notes(self) -> tuple[str, ...]:
        """A note about the mapping of samples of more than 8 bits to grey values, if necessary."""
        return (self._deep.words,) if self._deep is not None and self._deep.words else ()

    def __iter__(self) -> Iterator[Frame]:
        """Frames in order; an unreadable image is a frame with a fault."""
        for index, (path, time) in enumerate(zip(self.images, self.stamps.seconds, strict=True)):
            image, fault, name = None, None, path.name
            if any(self.pages):
                name = f"{name} page {self.pages[index]}"
            try:
                image = self._samples(index)
                if image.dtype == np.uint16:
                    assert self._deep is not None
                    image = self._deep(image)
            except UnreadableImageError as error:
                fault = str(error)
            yield Frame(index=index, timestamp=time, image=image, name=name, fault=fault)

    @cached_property
    def _deep(self) -> GreyTable | None:
        """Table for samples of more than 8 bits; None if the first readable image has 8 bits."""
        return GreyTable.for_source(self._examples())

    def _examples(self) -> Iterator[np.ndarray]:
        for index in range(0, len(self.images), max(len(self.images) // EXAMPLES, 1)):
            with suppress(UnreadableImageError):
                yield self._samples(index)

    def _samples(self, index: int) -> np.ndarray:
        page = self.pages[index] if self.pages else 0
        if page:
            try:
                return read_page(self.images[index], page)
            except Exception as error:  # Pillow raises many kinds of errors for damaged files
                raise UnreadableImageError(f"page {page} cannot be decoded") from error
        return read_samples(self.images[index], self.max_megapixels)
