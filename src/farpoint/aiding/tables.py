"""CSV files of speeds and of positions, with time stamps."""

from __future__ import annotations

import csv
import math
from array import array
from collections.abc import Generator
from contextlib import closing
from itertools import islice
from pathlib import Path

import numpy as np

from farpoint.errors import InputError
from farpoint.regular_files import regular_lines

__all__ = ["earth_centred", "read_gnss", "read_speeds"]

_LARGEST_BYTES = 1 << 28
_MOST_ROWS = 4_000_000  # 11 hours at 100 rows per second
_LARGEST = 1e12  # of a time in s, a speed in m/s or a coordinate in m or deg
_EQUATOR_M, _FLATTENING = 6378137.0, 1.0 / 298.257223563  # WGS 84


def read_speeds(path: str | Path, column: str = "speed") -> tuple[np.ndarray, np.ndarray]:
    """Times (N,), s, and absolute speeds (N,), m/s, from two columns of a CSV file.

    The times are in the column ``timestamp``. The argument ``column`` is the name of the column
    with the speeds.

    Raises
    ------
    InputError
        If the file is invalid. The message has the file, the line and the expected value.
    """
    table = _read(Path(path), ("timestamp", column))
    return table[:, 0], np.abs(table[:, 1])


def read_gnss(path: str | Path) -> tuple[np.ndarray, np.ndarray]:
    """Times (N,), s, and positions (N, 3), m, of a CSV file.

    The columns are ``timestamp,x,y,z`` in metres of any fixed axes, or
    ``timestamp,latitude,longitude,altitude`` in degrees and metres (WGS 84). Latitudes, longitudes
    and altitudes are converted to earth-centred axes.

    Raises
    ------
    InputError
        If the file is invalid. The message has the file, the line and the expected value.
    """
    path = Path(path)
    if "latitude" in _header(path):
        table = _read(path, ("timestamp", "latitude", "longitude", "altitude"))
        for line, latitude in enumerate(table[:, 1], start=2):
            if abs(latitude) > 90.0:
                raise InputError(
                    f"expected a latitude, -90 to 90, got {latitude}",
                    file=path,
                    field=f"row {line}",
                )
        return table[:, 0], earth_centred(
            np.radians(table[:, 1]), np.radians(table[:, 2]), table[:, 3]
        )
    table = _read(path, ("timestamp", "x", "y", "z"))
    return table[:, 0], table[:, 1:]


def earth_centred(latitude: np.ndarray, longitude: np.ndarray, up_m: np.ndarray) -> np.ndarray:
    """Positions (N, 3), m, of latitudes and longitudes (N,), rad, and heights, m (WGS 84)."""
    squeeze = _FLATTENING * (2.0 - _FLATTENING)
    radius = _EQUATOR_M / np.sqrt(1.0 - squeeze * np.sin(latitude) ** 2)
    out = (radius + up_m) * np.cos(latitude)
    north = (radius * (1.0 - squeeze) + up_m) * np.sin(latitude)
    return np.column_stack([out * np.cos(longitude), out * np.sin(longitude), north])


def _header(path: Path) -> list[str]:
    with closing(_cells(path)) as lines:
        return [name.strip() for name in next(lines, (1, []))[1]]


def _cells(path: Path) -> Generator[tuple[int, list[str]]]:
    """Line number and cells of each line."""
    text = regular_lines(path, limit_bytes=_LARGEST_BYTES, what="a table", newline="")
    lines = csv.reader(text)
    while True:
        try:
            cells = next(lines)
        except StopIteration:
            return
        except csv.Error as error:
            raise InputError(
                f"expected a table: {error}", file=path, field=f"line {lines.line_num}"
            ) from error
        yield lines.line_num, cells


def _read(path: Path, columns: tuple[str, ...]) -> np.ndarray:
    header = _header(path)
    missing = [name for name in columns if name not in header]
    if missing:
        raise InputError(
            f"expected the columns {','.join(columns)}, got {','.join(header) or 'none'}",
            file=path,
            field="line 1",
        )
    where = [header.index(name) for name in columns]
    numbers, count, last_s = array("d"), 0, -math.inf
    for line, cells in islice(_cells(path), 1, None):
        if not cells:
            continue
        row = _numbers(cells, where, path, line)
        if row[0] <= last_s:
            raise InputError(
                f"expected a time after {last_s} s, got {row[0]}",
                file=path,
                field=f"line {line}",
            )
        numbers.extend(row)
        count, last_s = count + 1, row[0]
        if count > _MOST_ROWS:
            raise InputError(f"expected a table of at most {_MOST_ROWS} rows", file=path)
    if count < 2:
        raise InputError(f"expected at least 2 rows of numbers, got {count}", file=path)
    return np.array(numbers).reshape(count, -1)


def _numbers(cells: list[str], where: list[int], path: Path, line: int) -> list[float]:
    try:
        row = [float(cells[index]) for index in where]
        if all(abs(number) <= _LARGEST for number in row):
            return row
        problem = f"expected finite numbers of at most {_LARGEST:g}"
    except IndexError:
        problem = f"expected at least {max(where) + 1} cells, got {len(cells)}"
    except ValueError as error:
        problem = str(error).replace("could not convert string to float:", "expected a number, got")
    raise InputError(problem, file=path, field=f"line {line}")
