"""EuRoC sequences, and sequences with the same layout (TUM-VI, Basalt): ``cam0/data.csv``."""

from __future__ import annotations

from pathlib import Path

from farpoint.frames.listing import is_image_list, sequence_from_list
from farpoint.frames.sequence import ImageSequence

__all__ = ["open_euroc"]

_LISTS = ("mav0/cam0/data.csv", "cam0/data.csv", "data.csv", "cam0_data.csv")


def open_euroc(folder: Path) -> ImageSequence | None:
    """Camera 0 of a sequence, or the camera whose folder is given; None for other folders.

    Time stamps come from the list of the images, which has nanoseconds.
    """
    for name in _LISTS:
        path = folder / name
        if is_image_list(path):
            places = (path.parent / "data", path.parent / "images", path.parent)
            return sequence_from_list(path, root=folder, folders=places)
    return None
