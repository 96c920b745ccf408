"""Lists of drives, made from sources, patterns of sources, and files that list sources."""

from __future__ import annotations

import csv
import glob
import shlex
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from farpoint.errors import InputError
from farpoint.frames.files import natural_key, read_lines
from farpoint.frames.remote import is_remote, remote_place
from farpoint.regular_files import read_regular_file

__all__ = ["ListedDrive", "list_drives"]

_LARGEST_LIST_BYTES = 1 << 28


@dataclass(frozen=True, kw_only=True)
class ListedDrive:
    """A source, with options from a list.

    Attributes
    ----------
    source : str
        Source of the drive.
    options : dict of str to str
        Options of ``farpoint run`` by name, without the dashes.
    place : str
        Place in a list, named in errors; empty for a source from the command line.
    """

    source: str
    options: dict[str, str] = field(default_factory=dict)
    place: str = ""


def list_drives(sources: Iterable[str]) -> list[ListedDrive]:
    """Drives of all sources, patterns and lists, in order and without duplicates.

    Parameters
    ----------
    sources : iterable of str
        Each element is a source of ``farpoint run``, a pattern whose matches are sources, or a
        list. A list is a CSV file with the column ``source`` and further columns named after
        options, or a text file with a source and, optionally, a calibration in each line.

    Raises
    ------
    InputError
        If a list cannot be read, a pattern matches nothing, or there is no drive.
    """
    found: dict[tuple[str, tuple[tuple[str, str], ...]], ListedDrive] = {}
    for source in sources:
        for drive in _listed(source):
            found.setdefault((drive.source, tuple(sorted(drive.options.items()))), drive)
    if not found:
        raise InputError("names no drive", field="SOURCES")
    return list(found.values())


def _listed(source: str) -> Iterator[ListedDrive]:
    path = Path(source).expanduser()
    if path.suffix.lower() == ".csv":
        yield from _of_table(path)
    elif path.suffix.lower() in (".txt", ".list"):
        yield from _of_lines(path)
    elif glob.has_magic(source) and not path.exists():
        yield from (ListedDrive(source=match) for match in _matches(source))
    else:
        yield ListedDrive(source=source)


def _matches(pattern: str) -> list[str]:
    if is_remote(pattern):
        system, path = remote_place(pattern)
        found = [system.unstrip_protocol(match) for match in system.glob(path)]
    else:
        found = glob.glob(str(Path(pattern).expanduser()), recursive=True)  # noqa: PTH207
    if not found:
        raise InputError("matches nothing", file=pattern)
    return sorted(found, key=natural_key)


def _of_table(path: Path) -> Iterator[ListedDrive]:
    try:
        data = read_regular_file(path, limit_bytes=_LARGEST_LIST_BYTES, what="a list")
        rows = csv.reader(data.decode("utf-8-sig").splitlines(), strict=True)
        header = [name.strip().removeprefix("--") for name in next(rows, [])]
        if "source" not in header:
            raise InputError("missing: expected the column source", file=path, field="line 1")
        if len(set(header)) < len(header):
            raise InputError("a column stands twice", file=path, field="line 1")
        for row in rows:
            if not any(cell.strip() for cell in row):
                continue
            place = f"line {rows.line_num}"
            if len(row) != len(header):
                raise InputError(
                    f"expected {len(header)} columns, got {len(row)}", file=path, field=place
                )
            cells = {name: cell.strip() for name, cell in zip(header, row, strict=True)}
            source = cells.pop("source")
            if not source:
                raise InputError("names no source", file=path, field=place)
            yield _beside(path, source, {k: v for k, v in cells.items() if v}, place)
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"is not a CSV file: {error}", file=path) from error
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from error


def _of_lines(path: Path) -> Iterator[ListedDrive]:
    try:
        lines = read_lines(path)
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from error
    for number, line in lines:
        place = f"line {number}"
        try:
            source, *camera = shlex.split(line)
        except ValueError as error:
            raise InputError(str(error), file=path, field=place) from error
        if len(camera) > 1:
            raise InputError(
                f"expected a source and a calibration, got {line[:60]!r}", file=path, field=place
            )
        yield _beside(path, source, {"camera": camera[0]} if camera else {}, place)


def _beside(path: Path, source: str, options: dict[str, str], place: str) -> ListedDrive:
    """A drive whose relative paths start at the folder of the list."""

    def found(name: str) -> str:
        near = path.parent / name
        return str(near) if "://" not in name and near.exists() else name

    files = ("camera", "mask")
    options = {k: found(v) if k in files else v for k, v in options.items()}
    return ListedDrive(source=found(source), options=options, place=f"{path}: {place}")
