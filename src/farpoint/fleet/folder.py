"""The folder of a drive, which either is complete or does not exist."""

from __future__ import annotations

import json
import os
import shutil
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

from farpoint.sinks.files import unwritable

__all__ = ["DRIVES", "clear_unfinished", "facts_of", "finish_folder", "is_finished"]

DRIVES = "drives"
"""Name of the folder with the drives, in the folder of the fleet."""

_RECORD = "fleet.json"
_UNFINISHED = ".unfinished-"


def is_finished(folder: Path, key: str) -> bool:
    """Whether the folder holds the results of the drive with this key."""
    return _record_of(folder).get("key") == key


def facts_of(folder: Path) -> dict[str, Any]:
    """Facts about the results, stored when the folder was finished."""
    return _record_of(folder).get("facts") or {}


def finish_folder(folder: Path, key: str, fill: Callable[[Path], dict[str, Any]]) -> None:
    """Fill a folder under a temporary name, and rename the folder when complete.

    An earlier folder of this name is replaced, unless the earlier folder has the same key. Then
    another worker was faster, and the results of the faster worker stay.

    Parameters
    ----------
    folder : Path
        Final name of the folder.
    key : str
        Key of the drive.
    fill : callable
        Fills a folder, and returns the facts to store about the results.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    part = folder.with_name(f"{_UNFINISHED}{uuid.uuid4().hex[:8]}-{folder.name}")
    try:
        record = {"key": key, "facts": fill(part)}
        (part / _RECORD).write_text(json.dumps(record) + "\n", encoding="utf-8")
        if is_finished(folder, key):
            return
        if folder.exists():
            folder.rename(part.with_name(f"{part.name}-before"))
            shutil.rmtree(part.with_name(f"{part.name}-before"), ignore_errors=True)
        _rename(part, folder, key)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _record_of(folder: Path) -> dict[str, Any]:
    try:
        record = json.loads((folder / _RECORD).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return record if isinstance(record, dict) else {}


def clear_unfinished(drives: Path) -> None:
    """Remove incomplete folders of killed workers. Call this only while no worker is running."""
    for left in drives.glob(f"{_UNFINISHED}*"):
        shutil.rmtree(left, ignore_errors=True)


def _rename(part: Path, folder: Path, key: str) -> None:
    try:
        os.rename(part, folder)  # noqa: PTH104 (refuses a folder that holds something)
    except OSError as error:
        if not is_finished(folder, key):
            raise unwritable(folder, error) from error
