"""ROS 2 bag in a folder: ``metadata.yaml`` and the files that ``metadata.yaml`` names."""

from __future__ import annotations

import os
import shutil
import tempfile
import weakref
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

from farpoint.errors import InputError
from farpoint.frames.bags.compression import unpack_file, unpack_message
from farpoint.frames.bags.records import Bag, BrokenBagError, Message, Topic
from farpoint.frames.files import natural_key
from farpoint.regular_files import read_regular_file

__all__ = ["BagFolder", "bag_files"]

METADATA = "metadata.yaml"
_SUFFIXES = (".db3", ".mcap", ".bag")
_PACKED = (".zstd", ".zst")
_ENDINGS = (*_SUFFIXES, *(suffix + packed for suffix in _SUFFIXES for packed in _PACKED))
_LARGEST_METADATA = 1 << 24
_LARGEST_FILES = 100_000

Open = Callable[[Path], Bag]


def bag_files(folder: Path) -> list[Path]:
    """The files of a bag in a folder; empty if the folder has no such files."""
    with os.scandir(folder) as entries:
        names = [entry.name for entry in entries if entry.name.endswith(_ENDINGS)]
    return [folder / name for name in sorted(names, key=natural_key)]


class BagFolder:
    """The files of a bag, one after the other.

    Parameters
    ----------
    path : Path
        The folder.
    open_file : callable
        Opens a file of the bag.
    """

    def __init__(self, path: Path, open_file: Open) -> None:
        self.path = path
        self._open = open_file
        facts = _facts(path / METADATA)
        self._messages_are_packed = str(facts.get("compression_mode", "")).upper() == "MESSAGE"
        self._names = _file_names(facts) or [file.name for file in bag_files(path)]

    @cached_property
    def _unpacked(self) -> Path:
        """Temporary folder for decompressed files, removed with this object."""
        folder = tempfile.mkdtemp(prefix="farpoint-bag-")
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        return Path(folder)

    @cached_property
    def _parts(self) -> list[tuple[str, Bag | None, str | None]]:
        """Name of each file, the opened file or None, and the fault or None."""
        return [(name, *self._part(self.path / name)) for name in self._names]

    def topics(self) -> list[Topic]:
        """Topics of all files, with the total number of messages."""
        merged: dict[str, Topic] = {}
        problem: InputError | None = None
        for name, part, fault in self._parts:
            if part is None:
                problem = problem or InputError(fault or "", file=self.path / name)
                continue
            for topic in part.topics():
                before = merged.get(topic.name)
                if before is not None:
                    known = before.count is not None and topic.count is not None
                    both = (before.count or 0) + (topic.count or 0)
                    topic = replace(before, count=both if known else None)
                merged[topic.name] = topic
        if not merged and problem is not None:
            raise problem
        return list(merged.values())

    def messages(self, names: Collection[str]) -> Iterator[Message]:
        """Messages of some topics; a missing file gives a lost message with a fault."""
        for name, part, fault in self._parts:
            if part is not None:
                for message in part.messages(names):
                    yield self._whole(message)
            if fault is not None:
                yield Message(topic=None, time_ns=None, fault=f"{name}: {fault}")

    def _whole(self, message: Message) -> Message:
        if not self._messages_are_packed or message.fault is not None:
            return message
        try:
            return replace(message, data=unpack_message(message.data))
        except BrokenBagError as error:
            return replace(message, data=b"", fault=str(error))

    def _part(self, path: Path) -> tuple[Bag | None, str | None]:
        if not path.is_file() and path.suffix in _PACKED and path.with_suffix("").is_file():
            path = path.with_suffix("")  # decompressed by the user
        if not path.is_file():
            return None, "is missing"
        fault = None
        try:
            if path.suffix in _PACKED:
                unpacked = self._unpacked / path.stem
                fault = unpack_file(path, unpacked)
                path = unpacked
            part = self._open(path)
            part.topics()
        except InputError as error:
            return None, fault or error.problem
        return part, fault


def _facts(metadata: Path) -> dict[str, Any]:
    """Metadata of a bag; empty if unreadable, because the files contain most of the metadata."""
    import yaml  # imported on use

    try:
        data = read_regular_file(metadata, limit_bytes=_LARGEST_METADATA, what="a description")
        facts = yaml.load(data, yaml.SafeLoader)["rosbag2_bagfile_information"]
    except (InputError, OSError, yaml.YAMLError, KeyError, TypeError, ValueError, RecursionError):
        return {}
    return facts if isinstance(facts, dict) else {}


def _file_names(facts: dict[str, Any]) -> list[str]:
    """Names of the files of the bag, without the folder that older bags add."""
    names = facts.get("relative_file_paths")
    if not isinstance(names, list):
        return []
    return [Path(str(name)).name for name in names[:_LARGEST_FILES]]
