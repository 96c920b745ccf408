"""Text files that list images and times, as in EuRoC, TUM and RPG sequences."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from farpoint.errors import InputError
from farpoint.frames.calibration import find_calibration
from farpoint.frames.clock import parse_seconds
from farpoint.frames.files import is_image, read_lines, source_name
from farpoint.frames.sequence import ImageSequence
from farpoint.frames.stamps import Stamps, require_order

__all__ = ["is_image_list", "sequence_from_list"]


@dataclass(frozen=True)
class _Row:
    line: int
    seconds: float
    file: Path


def is_image_list(path: Path) -> bool:
    """Whether the first row is that of an image list (COLMAP also writes an ``images.txt``)."""
    if not path.is_file():
        return False
    try:
        return any(_parse_row(*line, file=path) for line in read_lines(path)[:1])
    except InputError:
        return False


def sequence_from_list(path: Path, *, root: Path, folders: tuple[Path, ...]) -> ImageSequence:
    """The images and times in a list.

    Rows before the first existing image and after the last existing image are left out, so that a
    part of a sequence can be read. Missing images between these two images are frames with a fault.

    Parameters
    ----------
    path : Path
        The list, of rows ``[id] time file`` separated by blanks or commas.
    root : Path
        The folder of the sequence, from which the name of the sequence is made.
    folders : tuple of Path
        Folders to which the file names may be relative. The first folder that contains any of the
        files is used.

    Raises
    ------
    InputError
        If a row cannot be read, if times decrease, or if no listed image exists.
    """
    rows = [_parse_row(line, text, file=path) for line, text in read_lines(path)]
    require_order([(row.line, row.seconds) for row in rows], path)
    for folder in folders:
        there = [index for index, row in enumerate(rows) if (folder / row.file).is_file()]
        if there:
            rows = rows[there[0] : there[-1] + 1]
            images = tuple(folder / row.file for row in rows)
            return ImageSequence(
                name=source_name(root),
                images=images,
                stamps=Stamps(seconds=tuple(row.seconds for row in rows), source=path.name),
                calibration_path=find_calibration(images[0].parent, path.parent, root),
            )
    raise InputError(f"lists {len(rows)} images, none of which is there", file=path)


def _parse_row(line: int, text: str, *, file: Path) -> _Row:
    words = text.replace(",", " ").split()
    try:
        *_, time, name = words
        if len(words) <= 3 and is_image(name):
            return _Row(line, parse_seconds(time), Path(name))
    except ValueError:
        pass
    raise InputError(
        f"expected a time and an image file, got {text[:60]!r}", file=file, field=f"line {line}"
    )
