"""Recognition of bags by the first bytes of a file."""

from __future__ import annotations

from pathlib import Path, PurePosixPath

from farpoint.errors import InputError, require
from farpoint.frames.bags import mcap, rosbag1, sqlite
from farpoint.frames.bags.folder import METADATA, BagFolder, bag_files
from farpoint.frames.bags.records import Bag

__all__ = ["holds_bag", "is_bag", "is_bag_file", "open_bag"]

_MARKS = (rosbag1.MAGIC[:8], mcap.MAGIC)  # "#ROSBAG " of any version
_SUFFIXES = (".bag", ".mcap", ".db3")


def is_bag(path: Path) -> bool:
    """Whether a path is a file of a bag or the folder of a ROS 2 bag."""
    if path.is_dir():
        return (path / METADATA).is_file() and _names_a_bag(path)
    return is_bag_file(path.name) or _begin(path).startswith(_MARKS)


def is_bag_file(name: str) -> bool:
    """Whether a file has the suffix of a bag."""
    return PurePosixPath(name).suffix in _SUFFIXES


def holds_bag(folder: Path) -> bool:
    """Whether a folder contains files of bags."""
    return bool(bag_files(folder))


def open_bag(path: Path) -> Bag:
    """Open a bag and read its topics.

    Raises
    ------
    InputError
        If ``path`` is no bag or cannot be read.
    MissingExtraError
        If the library that reads messages is not installed.
    """
    require("rosbags", extra="ros", purpose="reading a bag")
    try:
        bag = BagFolder(path, _open_file) if path.is_dir() else _open_file(path)
        bag.topics()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", file=path) from error
    return bag


def _names_a_bag(folder: Path) -> bool:
    with (folder / METADATA).open("rb") as file:
        return b"rosbag2_bagfile_information" in file.read(1 << 12)


def _open_file(path: Path) -> Bag:
    begin = _begin(path)
    if begin.startswith(mcap.MAGIC):
        return mcap.McapFile(path)
    if begin.startswith(sqlite.MAGIC):
        return sqlite.SqliteBag(path)
    if begin.startswith(rosbag1.MAGIC):
        return rosbag1.Ros1Bag(path)
    if begin.startswith(b"#ROSBAG"):
        version = begin.split(b"\n")[0].decode("latin-1").removeprefix("#ROSBAG V")
        raise InputError(f"is a ROS 1 bag of version {version}; expected 2.0", file=path)
    raise InputError("expected a bag (ROS 1, ROS 2 or MCAP)", file=path)


def _begin(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(16)
