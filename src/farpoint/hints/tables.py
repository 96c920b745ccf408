"""CSV files of speeds and of positions, with time stamps."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np

from farpoint.errors import InputError

__all__ = ["earth_centred", "read_gnss", "read_speeds"]

_EQUATOR_M, _FLATTENING = 6378137.0, 1.0 / 298.257223563  # WGS 84


def read_speeds(path: str | Path, column: str = "speed") -> tuple[np.ndarray, np.ndarray]:
    """Times (N,), s, and speeds (N,), m/s, of two columns of a CSV file: ``timestamp``, ``column``.

    Raises
    ------
    InputError
        With the file, the line and what was expected there.
    """
    table = _read(Path(path), ("timestamp", column))
    return table[:, 0], np.abs(table[:, 1])


def read_gnss(path: str | Path) -> tuple[np.ndarray, np.ndarray]:
    """Times (N,), s, and positions (N, 3), m, of a CSV file.

    Its columns are ``timestamp,x,y,z`` in metres of any fixed axes, or
    ``timestamp,latitude,longitude,altitude`` in degrees and metres (WGS 84), which become
    earth-centred axes.

    Raises
    ------
    InputError
        With the file, the line and what was expected there.
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
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            return [name.strip() for name in next(csv.reader(file), [])]
    except UnicodeDecodeError as error:
        raise InputError("expected a text file", file=path) from error
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from error


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
    rows = []
    with path.open(encoding="utf-8-sig", newline="") as file:
        for line, cells in enumerate(csv.reader(file), start=1):
            if line == 1 or not cells:
                continue
            rows.append(_numbers(cells, where, path, line))
            if len(rows) > 1 and rows[-1][0] <= rows[-2][0]:
                raise InputError(
                    f"expected a time after {rows[-2][0]} s, got {rows[-1][0]}",
                    file=path,
                    field=f"line {line}",
                )
    if len(rows) < 2:
        raise InputError(f"expected at least 2 rows of numbers, got {len(rows)}", file=path)
    return np.array(rows)


def _numbers(cells: list[str], where: list[int], path: Path, line: int) -> list[float]:
    try:
        row = [float(cells[index]) for index in where]
        if all(map(math.isfinite, row)):
            return row
        problem = "expected finite numbers"
    except IndexError:
        problem = f"expected at least {max(where) + 1} cells, got {len(cells)}"
    except ValueError as error:
        problem = str(error).replace("could not convert string to float:", "expected a number, got")
    raise InputError(problem, file=path, field=f"line {line}")
