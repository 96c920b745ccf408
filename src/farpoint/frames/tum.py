"""TUM RGB-D sequences (``rgb.txt``) and RPG event-camera sequences (``images.txt``)."""

from __future__ import annotations

from pathlib import Path

from farpoint.frames.listing import is_image_list, sequence_from_list
from farpoint.frames.sequence import ImageSequence

__all__ = ["open_tum"]


def open_tum(folder: Path) -> ImageSequence | None:
    """Images and times listed in ``rgb.txt`` or ``images.txt``; None for other folders."""
    for name in ("rgb.txt", "images.txt"):
        path = folder / name
        if is_image_list(path):
            return sequence_from_list(path, root=folder, folders=(folder, folder / "images"))
    return None
