"""The folder of a drive: complete, or not there."""

from __future__ import annotations

import json
import os
import shutil
import uuid
from collections.abc import Callable
from pathlib import Path

from farpoint.sinks.files import unwritable

__all__ = ["DRIVES", "clear_unfinished", "finish_folder", "is_finished"]

DRIVES = "drives"
"""Where the folders of the drives are, within that of the fleet."""

_RECORD = "fleet.json"
_UNFINISHED = ".unfinished-"


def is_finished(folder: Path, key: str) -> bool:
    """Whether the folder holds the results of the drive with this key."""
    try:
        return json.loads((folder / _RECORD).read_text(encoding="utf-8"))["key"] == key
    except (OSError, ValueError, KeyError, TypeError):
        return False


def finish_folder(folder: Path, key: str, fill: Callable[[Path], None]) -> None:
    """Fill a folder under another name, and give it its name when all is in it.

    An earlier folder of that name is replaced, but for one with the same key: then another worker
    was faster, and its results stay.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    part = folder.with_name(f"{_UNFINISHED}{uuid.uuid4().hex[:8]}-{folder.name}")
    try:
        fill(part)
        (part / _RECORD).write_text(json.dumps({"key": key}) + "\n", encoding="utf-8")
        if is_finished(folder, key):
            return
        if folder.exists():
            folder.rename(part.with_name(f"{part.name}-before"))
            shutil.rmtree(part.with_name(f"{part.name}-before"), ignore_errors=True)
        _rename(part, folder, key)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def clear_unfinished(drives: Path) -> None:
    """Remove what killed workers left of drives; only while nobody works there."""
    for left in drives.glob(f"{_UNFINISHED}*"):
        shutil.rmtree(left, ignore_errors=True)


def _rename(part: Path, folder: Path, key: str) -> None:
    try:
        os.rename(part, folder)  # noqa: PTH104 (refuses a folder that holds something)
    except OSError as error:
        if not is_finished(folder, key):
            raise unwritable(folder, error) from error
