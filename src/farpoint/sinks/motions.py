"""``motions.csv``: a row for each pair of frames, with numbers in full precision."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields
from itertools import islice
from pathlib import Path

import numpy as np

from farpoint.errors import InputError
from farpoint.geometry import so3
from farpoint.geometry.sphere import tangent_basis
from farpoint.odometry import OdometryResult
from farpoint.pose import PoseStatus, RelativePose
from farpoint.sinks.claims import check_size, is_index
from farpoint.sinks.sink import TextSink

__all__ = ["COLUMNS", "Motions", "MotionsFile", "iter_motions", "read_motions"]

_UPPER_TRIANGLE = np.triu_indices(5)
_COVARIANCE = tuple(f"cov_{row}{column}" for row, column in zip(*_UPPER_TRIANGLE, strict=True))
_ROTATION_COVARIANCE = ("cov_00", "cov_01", "cov_02", "cov_11", "cov_12", "cov_22")
_COUNTS = ("tracks", "far", "near", "outliers")
_WHOLE = ("frame0", "frame1", *_COUNTS)
_ALWAYS = ("timestamp0", "timestamp1", *_WHOLE)
_QUATERNION = ("qx", "qy", "qz", "qw")
_DIRECTION = ("dx", "dy", "dz")

COLUMNS = (
    "timestamp0", "timestamp1", "frame0", "frame1", "status", *_QUATERNION, *_DIRECTION,
    "scale", "scale_sigma", *_COUNTS, "noise_px", *_COVARIANCE,
)  # fmt: skip
"""The header of the file."""

_UNIT_TOLERANCE = 1e-6
_INDEX = {name: index for index, name in enumerate(COLUMNS)}
_STATUS = _INDEX["status"]

_REQUIRED = {
    PoseStatus.OK: (*_ALWAYS, *_QUATERNION, *_DIRECTION, *_COVARIANCE),
    PoseStatus.ROTATION_ONLY: (*_ALWAYS, *_QUATERNION, *_ROTATION_COVARIANCE),
    PoseStatus.STATIC: (*_ALWAYS, *_QUATERNION, *_ROTATION_COVARIANCE),
    PoseStatus.FAILED: _ALWAYS,
}


class MotionsFile(TextSink):
    """The sink ``motions.csv``, which writes a row for each pair; the first frame has no pair.

    The covariance of the direction is in the basis `tangent_basis` of the direction in the row, so
    the file is self-contained.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, header=",".join(COLUMNS) + "\n")

    def lines(self, result: OdometryResult) -> str:
        """The row of this pair, or an empty text for the first frame."""
        if result.pose is None:
            return ""
        pose, stats = result.pose, result.pose.stats
        cells = [
            repr(float(result.timestamp0)),
            repr(float(result.timestamp)),
            str(result.frame0),
            str(result.frame1),
            pose.status.value,
            *_cells(_quat_xyzw(pose), 4),
            *_cells(pose.direction_cam1_from_cam0, 3),
            *_cells([result.scale, result.scale_sigma], 2),
            str(len(result.tracks)),
            str(stats.far),
            str(stats.near),
            str(stats.outliers),
            *_cells([pose.noise_px], 1),
            *_covariance_cells(pose),
        ]
        return ",".join(cells) + "\n"


@dataclass(frozen=True, kw_only=True, eq=False)
class Motions:
    """The rows of a ``motions.csv`` as columns; NaN where a row has no number.

    Attributes
    ----------
    timestamp0, timestamp1 : ndarray, shape (M,)
        Times of the older and the newer frame, s.
    frame0, frame1 : ndarray of int64, shape (M,)
        Indices of the frames in their source.
    status : ndarray of PoseStatus, shape (M,)
        Status of each pair. ``motions.status == PoseStatus.OK`` compares all elements.
    quat_xyzw : ndarray, shape (M, 4)
        Rotations cam1_from_cam0.
    direction_cam1_from_cam0 : ndarray, shape (M, 3)
        Unit vectors.
    scale, scale_sigma : ndarray, shape (M,)
        Length of the translation and its 1-sigma, in the unit of the trajectory.
    tracks, far, near, outliers : ndarray of int64, shape (M,)
        Counts of matches.
    noise_px : ndarray, shape (M,)
        1-sigma track noise per coordinate.
    covariance : ndarray, shape (M, 5, 5)
        Covariance of ``[dtheta, dbeta]``, rad^2. Unless the status is OK, the elements outside of
        the rotation block are NaN.
    """

    timestamp0: np.ndarray
    timestamp1: np.ndarray
    frame0: np.ndarray
    frame1: np.ndarray
    status: np.ndarray
    quat_xyzw: np.ndarray
    direction_cam1_from_cam0: np.ndarray
    scale: np.ndarray
    scale_sigma: np.ndarray
    tracks: np.ndarray
    far: np.ndarray
    near: np.ndarray
    outliers: np.ndarray
    noise_px: np.ndarray
    covariance: np.ndarray

    def __len__(self) -> int:
        return len(self.timestamp0)

    @property
    def rotation_cam1_from_cam0(self) -> np.ndarray:
        """Rotation matrices, shape (M, 3, 3); NaN where the pair failed."""
        known = np.isfinite(self.quat_xyzw[:, 0])
        R = np.full((len(self), 3, 3), np.nan)
        R[known] = so3.matrix_from_quat_xyzw(self.quat_xyzw[known])
        return R

    @property
    def rotation_covariance(self) -> np.ndarray:
        """Covariance of ``dtheta``, rad^2, shape (M, 3, 3); NaN where the pair failed."""
        return self.covariance[:, :3, :3]

    @property
    def direction_basis(self) -> np.ndarray:
        """The basis of ``dbeta``, shape (M, 3, 2); NaN where there is no direction."""
        return tangent_basis(self.direction_cam1_from_cam0)


def read_motions(path: str | Path) -> Motions:
    """Read a whole ``motions.csv``, even if the run was interrupted.

    An incomplete last line is left out.

    Raises
    ------
    InputError
        If the file is invalid; the message has the file, the line, the column and the expected
        value.
    """
    parts = list(iter_motions(path))
    if not parts:
        return _motions_of([], [])
    return Motions(
        **{
            field.name: np.concatenate([getattr(part, field.name) for part in parts])
            for field in fields(Motions)
        }
    )


def iter_motions(path: str | Path, chunk_rows: int = 2000) -> Iterator[Motions]:
    """Read a ``motions.csv`` part by part, with bounded memory."""
    rows = _rows(Path(path))
    while chunk := list(islice(rows, chunk_rows)):
        statuses, numbers = zip(*chunk, strict=True)
        yield _motions_of(statuses, numbers)


def _cells(values: Iterable[float | None] | None, count: int) -> list[str]:
    """Numbers as texts in full precision; an empty text stands for a missing value."""
    if values is None:
        return [""] * count
    return ["" if value is None else repr(float(value)) for value in values]


def _quat_xyzw(pose: RelativePose) -> np.ndarray | None:
    if pose.rotation_cam1_from_cam0 is None:
        return None
    return so3.quat_xyzw_from_matrix(pose.rotation_cam1_from_cam0)


def _covariance_cells(pose: RelativePose) -> list[str]:
    if pose.covariance is not None:
        return _cells(_covariance_in_standard_basis(pose)[_UPPER_TRIANGLE], 15)
    rows, columns = _UPPER_TRIANGLE
    block = pose.rotation_covariance
    return [
        repr(float(block[row, column])) if block is not None and max(row, column) < 3 else ""
        for row, column in zip(rows, columns, strict=True)
    ]


def _covariance_in_standard_basis(pose: RelativePose) -> np.ndarray:
    """Covariance (5, 5) with ``dbeta`` in `tangent_basis` of the direction."""
    covariance, basis = pose.covariance, pose.direction_basis
    assert covariance is not None
    assert basis is not None
    assert pose.direction_cam1_from_cam0 is not None
    standard = tangent_basis(pose.direction_cam1_from_cam0)
    if np.array_equal(standard, basis):
        return covariance  # unchanged; a product would change the last bits
    turn = np.eye(5)
    turn[3:, 3:] = standard.T @ basis
    return turn @ covariance @ turn.T


def _rows(path: Path) -> Iterator[tuple[PoseStatus, list[float]]]:
    try:
        with path.open(encoding="utf-8", newline="") as file:
            if file.readline().rstrip("\r\n").split(",") != list(COLUMNS):
                expected = ",".join(COLUMNS[:5])
                raise InputError(
                    f"expected the columns of motions.csv ({expected},...)",
                    file=path,
                    field="line 1",
                )
            for line, text in enumerate(file, start=2):
                if not text.endswith("\n"):
                    return
                yield _parsed(text.rstrip("\r\n").split(","), path, line)
    except UnicodeDecodeError as error:
        raise InputError("expected a text file of motions", file=path) from error
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from error


def _parsed(cells: list[str], path: Path, line: int) -> tuple[PoseStatus, list[float]]:
    def fault(problem: str, column: str | None = None) -> InputError:
        place = f"line {line}" if column is None else f"line {line}, column {column}"
        return InputError(problem, file=path, field=place)

    if len(cells) != len(COLUMNS):
        raise fault(f"expected {len(COLUMNS)} columns, got {len(cells)}")
    try:
        status = PoseStatus(cells[_STATUS])
    except ValueError:
        known = ", ".join(member.value for member in PoseStatus)
        raise fault(f"expected one of {known}, got {cells[_STATUS]!r}", "status") from None
    for column in _REQUIRED[status]:
        if not cells[_INDEX[column]]:
            raise fault(f"expected a number where the status is {status.value}", column)
    numbers = [np.nan] * len(COLUMNS)
    for index, cell in enumerate(cells):
        if cell and index != _STATUS:
            try:
                numbers[index] = float(cell)
            except ValueError:
                raise fault(f"expected a number, got {cell!r}", COLUMNS[index]) from None
            if not math.isfinite(numbers[index]):
                raise fault(f"expected a finite number, got {cell!r}", COLUMNS[index])
            if COLUMNS[index] in _WHOLE and not is_index(numbers[index]):
                raise fault(f"expected a whole number, 0 or more, got {cell!r}", COLUMNS[index])
    try:
        check_size(value for value in numbers if not math.isnan(value))
    except ValueError as error:
        raise fault(str(error)) from error
    for first, last in (("qx", "qw"), ("dx", "dz")):
        norm = math.hypot(*numbers[_INDEX[first] : _INDEX[last] + 1])
        if abs(norm - 1.0) > _UNIT_TOLERANCE:  # False for NaN: a missing vector is allowed
            raise fault(f"expected a unit vector, got one of norm {norm:.4g}", f"{first}..{last}")
    return status, numbers


def _motions_of(statuses: Iterable[PoseStatus], numbers: Iterable[list[float]]) -> Motions:
    table = np.array(list(numbers), np.float64).reshape(-1, len(COLUMNS))
    status = np.empty(len(table), object)
    status[:] = list(statuses)
    covariance = np.full((len(table), 5, 5), np.nan)
    rows, columns = _UPPER_TRIANGLE
    covariance[:, rows, columns] = table[:, _INDEX["cov_00"] :]
    covariance[:, columns, rows] = table[:, _INDEX["cov_00"] :]

    def column(name: str) -> np.ndarray:
        return table[:, _INDEX[name]]

    return Motions(
        timestamp0=column("timestamp0"),
        timestamp1=column("timestamp1"),
        frame0=column("frame0").astype(np.int64),
        frame1=column("frame1").astype(np.int64),
        status=status,
        quat_xyzw=table[:, _INDEX["qx"] : _INDEX["qw"] + 1],
        direction_cam1_from_cam0=table[:, _INDEX["dx"] : _INDEX["dz"] + 1],
        scale=column("scale"),
        scale_sigma=column("scale_sigma"),
        **{name: column(name).astype(np.int64) for name in _COUNTS},
        noise_px=column("noise_px"),
        covariance=covariance,
    )
