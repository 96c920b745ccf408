"""Times of images: from a file of times, from the file names, or from a frame rate."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

from farpoint.errors import InputError
from farpoint.frames.clock import parse_seconds, seconds_in_name
from farpoint.frames.files import read_lines

__all__ = ["DEFAULT_FPS", "Stamps", "find_stamps", "require_order"]

DEFAULT_FPS = 10.0
"""Frame rate, 1/s, of images without time stamps if the user gives none (KITTI's rate)."""

_TIMES_FILES = ("times.txt", "timestamps.txt")
_DATE = re.compile(r"[0-9]{4}-[0-9]{2}-[0-9]{2}")


@dataclass(frozen=True, kw_only=True)
class Stamps:
    """Time stamps of a list of images.

    Attributes
    ----------
    seconds : tuple of float
        Time stamp of each image, s.
    source : str
        Origin of the time stamps, as text.
    """

    seconds: tuple[float, ...]
    source: str


def find_stamps(images: Sequence[Path], fps: float | None) -> Stamps:
    """Time stamps of sorted images, from the first of three sources that exists.

    The sources are:

    1. ``times.txt`` or ``timestamps.txt`` in the folder of the images or in the parent folder. The
       file must have a row for each image. For a part of a sequence, the names of the images must
       instead be frame numbers, which are the numbers of the rows, counted from 0.
    2. The names of the images, if all are Unix times (EuRoC: nanoseconds, TUM: seconds with
       decimals).
    3. A frame rate of `fps`, or of `DEFAULT_FPS` if `fps` is None.
    """
    return (
        _from_times_file(images)
        or _from_names(images)
        or _from_rate(len(images), DEFAULT_FPS if fps is None else fps, assumed=fps is None)
    )


def require_order(rows: Sequence[tuple[int, float]], file: Path) -> None:
    """Raise InputError if the time of a row is before the time of the previous row.

    Each row is given as (line, seconds).
    """
    for (_, earlier), (line, later) in pairwise(rows):
        if later < earlier:
            raise InputError(
                f"time {later:.9g} s lies before the row above; expected them in order",
                file=file,
                field=f"line {line}",
            )


def _from_times_file(images: Sequence[Path]) -> Stamps | None:
    folders = {image.parent for image in images}
    if len(folders) != 1:
        return None
    folder = folders.pop()
    for path in (place / name for place in (folder, folder.parent) for name in _TIMES_FILES):
        if not path.is_file():
            continue
        lines = read_lines(path)
        rows = range(len(images)) if len(lines) == len(images) else _frame_numbers(images)
        if rows is not None and max(rows) < len(lines):
            times = [(lines[row][0], _time_of_row(*lines[row], file=path)) for row in rows]
            require_order(times, path)
            return Stamps(seconds=tuple(time for _, time in times), source=path.name)
    return None


def _frame_numbers(images: Sequence[Path]) -> list[int] | None:
    names = [image.stem for image in images]
    return [int(name) for name in names] if all(map(str.isdecimal, names)) else None


def _time_of_row(line: int, text: str, *, file: Path) -> float:
    """Seconds in a row ``time``, ``date time`` (KITTI raw, in UTC) or ``id time [exposure]``."""
    words = text.replace(",", " ").split()
    try:
        if _DATE.fullmatch(words[0]) and len(words) == 2:
            whole, _, decimals = words[1].partition(".")
            second = datetime.fromisoformat(f"{words[0]}T{whole}").replace(tzinfo=UTC)
            return second.timestamp() + float(f"0.{decimals or 0}")
        return parse_seconds(words[min(len(words), 2) - 1])
    except ValueError as error:
        raise InputError(
            f"expected a time in seconds or a date and time, got {text!r}",
            file=file,
            field=f"line {line}",
        ) from error


def _from_names(images: Sequence[Path]) -> Stamps | None:
    seconds = [time for image in images if (time := seconds_in_name(image)) is not None]
    increasing = all(earlier < later for earlier, later in pairwise(seconds))
    if len(seconds) < len(images) or not increasing:
        return None
    return Stamps(seconds=tuple(seconds), source="file names")


def _from_rate(count: int, fps: float, *, assumed: bool) -> Stamps:
    return Stamps(
        seconds=tuple(index / fps for index in range(count)),
        source=f"{fps:g} frames a second{', assumed' if assumed else ''}",
    )
