"""Check whether an input is unchanged, by names, sizes and modification times."""

from __future__ import annotations

import glob
import os
import stat
import urllib.request
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from farpoint.frames.remote import is_remote, remote_place

__all__ = ["size_of_input", "state_of_input"]

_TIMEOUT_S = 10.0
_STATE_KEYS = ("size", "mtime", "ETag", "etag", "md5Hash", "LastModified", "updated", "created")
"""Facts of fsspec's file systems about a file that change with its contents."""

State = list[list[Any]]


def state_of_input(name: str) -> State:
    """Rows with name, size and modification time, a row for each file of an input.

    The row of an unreadable file has the name only. The run reports the reason.
    """
    if is_remote(name):
        return _remote_state(name)
    if "://" in name:
        return _web_state(name)
    path = Path(name).expanduser()
    try:
        if stat.S_ISDIR(path.stat().st_mode):
            return _states(Path(top, file) for top, _, files in os.walk(path) for file in files)
        return _states([path])
    except OSError:
        return _states(map(Path, glob.glob(name, recursive=True))) or [[name]]  # noqa: PTH207


def size_of_input(state: State) -> int:
    """Total size of all files, bytes."""
    return sum(row[1] for row in state if len(row) > 1 and isinstance(row[1], int))


def _states(paths: Iterable[Path]) -> State:
    found: State = []
    for path in sorted(paths):
        try:
            of_file = path.stat()
        except OSError:
            found.append([str(path.absolute())])
            continue
        found.append([str(path.absolute()), of_file.st_size, of_file.st_mtime_ns])
    return found


def _remote_state(url: str) -> State:
    system, path = remote_place(url)
    try:
        files = system.find(path, detail=True)
    except Exception:  # each file system has errors of its own
        return [[url]]
    return [
        [
            name,
            *(str(info[key]) if key != "size" else info[key] for key in _STATE_KEYS if key in info),
        ]
        for name, info in sorted(files.items())
    ] or [[url]]


def _web_state(url: str) -> State:
    if not url.lower().startswith("http"):
        return [[url]]
    try:
        request = urllib.request.Request(url, method="HEAD")
        with urllib.request.urlopen(request, timeout=_TIMEOUT_S) as answer:
            headers = answer.headers
            size = int(headers.get("Content-Length") or 0)
            return [[url, size, headers.get("ETag", ""), headers.get("Last-Modified", "")]]
    except (OSError, ValueError):
        return [[url]]
