"""Images in files, each with its time: what every kind of folder comes down to."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from farpoint.errors import optional_import
from farpoint.frames.decode import UnreadableImageError, read_grey
from farpoint.frames.frame import Frame
from farpoint.frames.stamps import Stamps

__all__ = ["ImageSequence"]


@dataclass(frozen=True, kw_only=True)
class ImageSequence:
    """Image files in order; decodes one at a time, and can be iterated again.

    Attributes
    ----------
    name : str
        Short name of the source.
    images : tuple of Path
        The files, in order.
    stamps : Stamps
        Their times, one for each.
    calibration_path : Path or None
        A file near the images that looks like their calibration.
    """

    name: str
    images: tuple[Path, ...]
    stamps: Stamps
    calibration_path: Path | None = None

    def __post_init__(self) -> None:
        optional_import("cv2", extra="video", purpose="reading images")  # now, not in mid-run

    @property
    def count(self) -> int:
        """Number of images."""
        return len(self.images)

    @property
    def timestamp_source(self) -> str:
        """Where the time stamps come from."""
        return self.stamps.source

    def __iter__(self) -> Iterator[Frame]:
        """Frames in order; an image that cannot be had is a frame with a fault."""
        for index, (path, time) in enumerate(zip(self.images, self.stamps.seconds, strict=True)):
            image, fault = None, None
            try:
                image = read_grey(path)
            except UnreadableImageError as error:
                fault = str(error)
            yield Frame(index=index, timestamp=time, image=image, name=path.name, fault=fault)
