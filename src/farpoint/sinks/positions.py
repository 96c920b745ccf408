"""``positions.csv``: poses of the camera with covariances, also written as Parquet."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from farpoint.errors import InputError, optional_import
from farpoint.geometry import so3
from farpoint.sinks.claims import check_covariance, check_size, is_index
from farpoint.sinks.files import replacing
from farpoint.sinks.sink import PathFile, Posed

__all__ = [
    "COLUMNS",
    "PositionRow",
    "Positions",
    "PositionsFile",
    "iter_position_rows",
    "iter_positions",
    "load_pyarrow",
    "position_line",
    "read_positions",
    "write_positions_parquet",
]

_UPPER_TRIANGLE = np.triu_indices(7)

COLUMNS = (
    "timestamp", "frame", "segment", "x", "y", "z", "qx", "qy", "qz", "qw",
    *(f"cov_{row}{column}" for row, column in zip(*_UPPER_TRIANGLE, strict=True)),
)  # fmt: skip
"""The header of the file."""

_ROWS_AT_ONCE = 2000
_UNIT_TOLERANCE = 1e-6


class PositionRow(NamedTuple):
    """A row of the file: ``world_from_cam`` (4, 4) and ``covariance`` (7, 7), NaN if unknown."""

    timestamp: float
    frame: int
    segment: int
    world_from_cam: np.ndarray
    covariance: np.ndarray


class PositionsFile(PathFile):
    """Writer of a row for each frame: ``world_from_cam``, and the covariance of pose and scale."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, header=",".join(COLUMNS) + "\n")

    def lines(self, pose: Posed) -> str:
        """The row of this frame."""
        covariance = pose.world_covariance
        return position_line(
            PositionRow(
                timestamp=pose.timestamp,
                frame=pose.frame1,
                segment=pose.segment,
                world_from_cam=pose.world_from_cam,
                covariance=np.full((7, 7), np.nan) if covariance is None else covariance,
            )
        )


def position_line(row: PositionRow) -> str:
    """A row as a line of text, with the line end."""
    pose = row.world_from_cam
    numbers = [*pose[:3, 3], *so3.quat_xyzw_from_matrix(pose[:3, :3])]
    numbers += list(row.covariance[_UPPER_TRIANGLE])
    cells = [repr(float(row.timestamp)), str(row.frame), str(row.segment)]
    cells += ["" if math.isnan(value) else repr(float(value)) for value in numbers]
    return ",".join(cells) + "\n"


@dataclass(frozen=True, kw_only=True, eq=False)
class Positions:
    """The rows of a ``positions.csv`` as columns.

    Attributes
    ----------
    timestamps : ndarray, shape (N,)
        Times of the frames, s.
    frames, segments : ndarray of int64, shape (N,)
        Indices of the frames in their source, and of the segment of the path.
    positions : ndarray, shape (N, 3)
        Positions of the camera, in the unit of the trajectory.
    quat_xyzw : ndarray, shape (N, 4)
        Orientations ``world_from_cam``.
    covariances : ndarray, shape (N, 7, 7)
        Covariances of ``[dtheta, dposition, dlog_scale]``; NaN where unknown.
    """

    timestamps: np.ndarray
    frames: np.ndarray
    segments: np.ndarray
    positions: np.ndarray
    quat_xyzw: np.ndarray
    covariances: np.ndarray

    def __len__(self) -> int:
        return len(self.timestamps)

    @property
    def world_from_cam(self) -> np.ndarray:
        """Poses (N, 4, 4)."""
        poses = np.tile(np.eye(4), (len(self), 1, 1))
        poses[:, :3, 3] = self.positions
        for pose, quat in zip(poses, self.quat_xyzw, strict=True):
            pose[:3, :3] = so3.matrix_from_quat_xyzw(quat)
        return poses


def read_positions(path: str | Path) -> Positions:
    """Read a ``positions.csv``. An incomplete last line is left out.

    Raises
    ------
    InputError
        If the file is invalid; the message has the file, the line and the expected value.
    """
    path = Path(path)
    return _columns(np.array(list(_rows(path))), path)


def iter_positions(path: str | Path) -> Iterator[Positions]:
    """Read a ``positions.csv`` in parts of some thousand rows, with bounded memory."""
    path = Path(path)
    return (_columns(part, path) for part in _parts(_rows(path)))


def _columns(table: np.ndarray, path: Path) -> Positions:
    table = table.reshape(-1, len(COLUMNS))
    covariances = np.empty((len(table), 7, 7))
    rows, columns = _UPPER_TRIANGLE
    covariances[:, rows, columns] = table[:, 10:]
    covariances[:, columns, rows] = table[:, 10:]
    for frame, covariance in zip(table[:, 1], covariances, strict=True):
        try:
            check_covariance(covariance)
        except ValueError as error:
            raise InputError(str(error), file=path, field=f"frame {int(frame)}") from error
    return Positions(
        timestamps=table[:, 0],
        frames=table[:, 1].astype(np.int64),
        segments=table[:, 2].astype(np.int64),
        positions=table[:, 3:6],
        quat_xyzw=table[:, 6:10],
        covariances=covariances,
    )


def iter_position_rows(path: str | Path) -> Iterator[PositionRow]:
    """Read a ``positions.csv`` row by row."""
    for part in iter_positions(path):
        rows = (part.timestamps, part.frames, part.segments, part.world_from_cam, part.covariances)
        for timestamp, frame, segment, pose, covariance in zip(*rows, strict=True):
            yield PositionRow(float(timestamp), int(frame), int(segment), pose, covariance)


def load_pyarrow() -> tuple[Any, Any]:
    """Import ``pyarrow`` and ``pyarrow.parquet``, or raise an error that names the extra."""
    arrow = optional_import("pyarrow", extra="parquet", purpose="writing Parquet")
    parquet = optional_import("pyarrow.parquet", extra="parquet", purpose="writing Parquet")
    return arrow, parquet


def write_positions_parquet(folder: Path) -> None:
    """Write ``positions.csv`` as ``positions.parquet``, some thousand rows at a time."""
    arrow, parquet = load_pyarrow()
    whole = {"frame", "segment"}
    kinds = [(name, arrow.int64() if name in whole else arrow.float64()) for name in COLUMNS]
    schema = arrow.schema(kinds)
    with (
        replacing(folder / "positions.parquet") as part,
        parquet.ParquetWriter(str(part), schema) as writer,
    ):
        for rows in _parts(_rows(folder / "positions.csv")):
            columns = [
                arrow.array(column, type=kind, from_pandas=True)  # NaN: no value
                for column, (_, kind) in zip(rows.T, kinds, strict=True)
            ]
            writer.write_table(arrow.Table.from_arrays(columns, schema=schema))


def _parts(rows: Iterator[list[float]]) -> Iterator[np.ndarray]:
    part: list[list[float]] = []
    for row in rows:
        part.append(row)
        if len(part) == _ROWS_AT_ONCE:
            yield np.array(part)
            part = []
    if part:
        yield np.array(part)


def _rows(path: Path) -> Iterator[list[float]]:
    try:
        with path.open(encoding="utf-8", newline="") as file:
            if file.readline().rstrip("\r\n").split(",") != list(COLUMNS):
                raise InputError("expected the columns of positions.csv", file=path, field="line 1")
            whole_lines = (text for text in file if text.endswith("\n"))
            for line, cells in enumerate(csv.reader(whole_lines), start=2):
                try:
                    if len(cells) != len(COLUMNS):
                        raise ValueError(f"expected {len(COLUMNS)} columns, got {len(cells)}")
                    yield _checked([float(cell or "nan") for cell in cells])
                except ValueError as error:
                    raise InputError(str(error), file=path, field=f"line {line}") from error
    except UnicodeDecodeError as error:
        raise InputError("expected a text file of positions", file=path) from error
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from error


def _checked(row: list[float]) -> list[float]:
    for name, number in zip(COLUMNS[1:3], row[1:3], strict=True):
        if not is_index(number):
            raise ValueError(f"expected a whole number, 0 or more, as {name}, got {number!r}")
    if not all(map(math.isfinite, row[:10])):
        raise ValueError("expected finite numbers up to qw")
    check_size(row)
    if abs(math.hypot(*row[6:10]) - 1.0) > _UNIT_TOLERANCE:
        raise ValueError(
            f"expected a unit quaternion, got one of norm {math.hypot(*row[6:10]):.4g}"
        )
    return row
