"""Trajectory files: TUM, KITTI and EuRoC, read and written.

All of them hold poses ``world_from_body``; the body is the camera in TUM and KITTI files and the
IMU in EuRoC's. Positions keep the unit of the file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from farpoint.errors import InputError
from farpoint.geometry import so3

__all__ = [
    "Trajectory",
    "iter_tum",
    "kitti_line",
    "read_euroc",
    "read_kitti",
    "read_trajectory",
    "read_tum",
    "tum_line",
    "write_kitti",
    "write_tum",
]

_UNIT_TOLERANCE = 1e-2  # files round rotations to as few as four digits


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """Poses in the order of their file.

    Attributes
    ----------
    timestamps : ndarray, shape (N,), or None
        Seconds, never decreasing; None where the format has none (KITTI).
    world_from_body : ndarray, shape (N, 4, 4)
        Rigid transforms.
    """

    timestamps: np.ndarray | None
    world_from_body: np.ndarray

    def __len__(self) -> int:
        return len(self.world_from_body)


def read_trajectory(path: str | Path) -> Trajectory:
    """Read a TUM, KITTI or EuRoC trajectory, recognised by its first row of numbers.

    Raises
    ------
    InputError
        With the file, the line and what was expected there.
    """
    path = Path(path)
    for line, text in _rows(path):
        if "," in text:
            return read_euroc(path)
        columns = len(text.split())
        if columns == 8:
            return read_tum(path)
        if columns in (12, 16):
            return read_kitti(path)
        raise InputError(
            f"expected 8 numbers (TUM), 12 or 16 (KITTI) or commas (EuRoC), got {columns} columns",
            file=path,
            field=f"line {line}",
        )
    raise InputError("expected a trajectory, found no row of numbers", file=path)


def read_tum(path: str | Path) -> Trajectory:
    """Read rows of ``timestamp tx ty tz qx qy qz qw``, the time in seconds."""
    return _stacked(iter_tum(path), path)


def iter_tum(path: str | Path, *, whole_lines: bool = False) -> Iterator[tuple[float, np.ndarray]]:
    """Time and pose (4, 4) of each row of a TUM file, so that its length costs no memory.

    With ``whole_lines`` a last line without its end is left out: its run may have been killed
    while it was written.
    """

    def parse(text: str) -> tuple[float, np.ndarray]:
        row = _numbers(text.split(), 8, "timestamp tx ty tz qx qy qz qw")
        return row[0], _pose(_rotation(np.array(row[4:8])), row[1:4])

    return _stamped(Path(path), parse, whole_lines)


def read_euroc(path: str | Path) -> Trajectory:
    """Read EuRoC's ground truth, ``t[ns],px,py,pz,qw,qx,qy,qz[,...]``: poses of the IMU."""

    def parse(text: str) -> tuple[float, np.ndarray]:
        cells = text.split(",")[:8]
        row = _numbers(cells, 8, "t[ns],px,py,pz,qw,qx,qy,qz")
        # Nanoseconds since 1970 do not fit a float; their seconds nearly do.
        seconds = _nanoseconds(cells[0]) / 1e9
        return seconds, _pose(_rotation(np.roll(row[4:8], -1)), row[1:4])

    return _stacked(_stamped(Path(path), parse), path)


def read_kitti(path: str | Path) -> Trajectory:
    """Read rows of a 3x4 (or 4x4) matrix, one pose a line, row by row."""
    path = Path(path)
    poses = []
    for line, text in _rows(path):
        try:
            cells = text.split()
            row = _numbers(cells, 16 if len(cells) == 16 else 12, "the rows of a 3x4 matrix")
            matrix = np.array(row[:12]).reshape(3, 4)
            _check_rotation(matrix[:, :3])
        except ValueError as error:
            raise InputError(str(error), file=path, field=f"line {line}") from error
        poses.append(_pose(matrix[:, :3], matrix[:, 3]))
    if not poses:
        raise InputError("expected a trajectory, found no row of numbers", file=path)
    return Trajectory(timestamps=None, world_from_body=np.stack(poses))


def write_tum(path: str | Path, trajectory: Trajectory) -> None:
    """Write rows of ``timestamp tx ty tz qx qy qz qw``; numbers survive the round trip."""
    if trajectory.timestamps is None:
        raise InputError("expected time stamps, which a TUM file needs", field="trajectory")
    rows = zip(trajectory.timestamps, trajectory.world_from_body, strict=True)
    Path(path).write_text("".join(tum_line(stamp, pose) for stamp, pose in rows))


def write_kitti(path: str | Path, trajectory: Trajectory) -> None:
    """Write a 3x4 matrix a line, row by row, without time stamps."""
    Path(path).write_text("".join(map(kitti_line, trajectory.world_from_body)))


def tum_line(timestamp: float, world_from_body: np.ndarray) -> str:
    """One line of a TUM file, with its end, for a pose (4, 4)."""
    quat_xyzw = so3.quat_xyzw_from_matrix(world_from_body[:3, :3])
    values = (timestamp, *world_from_body[:3, 3], *quat_xyzw)
    return " ".join(repr(float(value)) for value in values) + "\n"


def kitti_line(world_from_body: np.ndarray) -> str:
    """One line of a KITTI file, with its end, for a pose (4, 4)."""
    return " ".join(repr(float(value)) for value in world_from_body[:3].ravel()) + "\n"


def _stamped(
    path: Path, parse: Callable[[str], tuple[float, np.ndarray]], whole_lines: bool = False
) -> Iterator[tuple[float, np.ndarray]]:
    last = -np.inf
    for line, text in _rows(path, whole_lines):
        try:
            stamp, pose = parse(text)
            if stamp < last:
                raise ValueError(f"expected a time of at least {last!r} s, got {stamp!r}")
        except ValueError as error:
            raise InputError(str(error), file=path, field=f"line {line}") from error
        last = stamp
        yield stamp, pose


def _stacked(rows: Iterator[tuple[float, np.ndarray]], path: str | Path) -> Trajectory:
    stamps, poses = [], []
    for stamp, pose in rows:
        stamps.append(stamp)
        poses.append(pose)
    if not poses:
        raise InputError("expected a trajectory, found no row of numbers", file=path)
    return Trajectory(timestamps=np.array(stamps), world_from_body=np.stack(poses))


def _rows(path: Path, whole_lines: bool = False) -> Iterator[tuple[int, str]]:
    """Numbered lines of a file that are neither empty nor comments."""
    try:
        with path.open(encoding="utf-8") as file:
            for line, text in enumerate(file, start=1):
                if whole_lines and not text.endswith("\n"):
                    return
                if text.strip() and not text.lstrip().startswith("#"):
                    yield line, text.strip()
    except UnicodeDecodeError as error:
        raise InputError("expected a text file of poses", file=path) from error
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from error


def _numbers(cells: list[str], count: int, expected: str) -> list[float]:
    if len(cells) != count:
        raise ValueError(f"expected {count} numbers ({expected}), got {len(cells)}")
    row = []
    for cell in cells:
        try:
            row.append(float(cell))
        except ValueError:
            raise ValueError(f"expected a number, got {cell!r}") from None
    if not all(map(math.isfinite, row)):
        raise ValueError("expected finite numbers")
    return row


def _nanoseconds(cell: str) -> int:
    try:
        return int(cell)
    except ValueError:
        raise ValueError(f"expected whole nanoseconds, got {cell!r}") from None


def _rotation(quat_xyzw: np.ndarray) -> np.ndarray:
    norm = math.hypot(*quat_xyzw)
    if abs(norm - 1.0) > _UNIT_TOLERANCE:
        raise ValueError(f"expected a unit quaternion, got one of norm {norm:.4g}")
    return so3.matrix_from_quat_xyzw(quat_xyzw)


def _check_rotation(R: np.ndarray) -> None:
    off = float(np.abs(R @ R.T - np.eye(3)).max())
    if off > _UNIT_TOLERANCE or np.linalg.det(R) < 0.0:
        raise ValueError("expected a rotation matrix in the first three columns")


def _pose(R: np.ndarray, position: np.ndarray | list[float]) -> np.ndarray:
    world_from_body = np.eye(4)
    world_from_body[:3, :3] = R
    world_from_body[:3, 3] = position
    return world_from_body
