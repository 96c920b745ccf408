"""Trajectory files: TUM, KITTI and EuRoC, read and written.

All formats hold poses ``world_from_body``. The body is the camera in TUM and KITTI files, and the
IMU in EuRoC files. Positions keep the unit of the file.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from farpoint.errors import InputError
from farpoint.geometry import so3
from farpoint.regular_files import regular_lines

__all__ = [
    "QuaternionOrder",
    "Trajectory",
    "iter_tum",
    "kitti_line",
    "named_order",
    "read_euroc",
    "read_kitti",
    "read_trajectory",
    "read_tum",
    "tum_line",
    "write_kitti",
    "write_tum",
]

QuaternionOrder = Literal["xyzw", "wxyz"]

_HEADER_LINES = 20  # number of first lines that may contain the names of the columns
_UNIT_TOLERANCE = 1e-2  # files round rotations to as few as four digits
_MAX_POSITION = 1e12  # in the unit of the file; a larger number is taken as an error in the file
_NANOSECOND_DIGITS = 15  # a whole number of 15 digits or more in column 1 is a time in nanoseconds
_LARGEST_BYTES = 1 << 30
_MOST_POSES = 4_000_000  # 5 hours at 200 poses per second; about 1 GB of memory
_BLOCK = 4096
_BOTTOM_ROW = (0.0, 0.0, 0.0, 1.0)
_SEPARATOR = re.compile(r"\s*[,;]\s*|\s+")


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """Poses in the order of their file.

    Attributes
    ----------
    timestamps : ndarray, shape (N,), or None
        Seconds, never decreasing; None if the format has no time stamps (KITTI).
    world_from_body : ndarray, shape (N, 4, 4)
        Rigid transforms.
    """

    timestamps: np.ndarray | None
    world_from_body: np.ndarray

    def __len__(self) -> int:
        return len(self.world_from_body)


def read_trajectory(path: str | Path, quaternion: QuaternionOrder | None = None) -> Trajectory:
    """Read a TUM, KITTI or EuRoC trajectory, recognised by its first row of numbers.

    Parameters
    ----------
    path : str or Path
        The file.
    quaternion : {"xyzw", "wxyz"}, optional
        Order of the elements of the quaternions in the file. By default the names of the columns
        give the order, if the file names its columns. Otherwise w is first in EuRoC files and last
        in TUM files.

    Raises
    ------
    InputError
        If the file is invalid. The message has the file, the line and the expected value.
    """
    path = Path(path)
    for line, text in _rows(path):
        cells = _cells(text)
        columns = len(cells)
        _check_places(path, columns)
        if _has_nanoseconds(text, cells):
            return _stacked(_euroc(path, quaternion or named_order(path) or "wxyz"), path)
        if columns == 8:
            return _stacked(_tum(path, quaternion or named_order(path) or "xyzw"), path)
        if columns in (12, 16):
            return read_kitti(path)
        raise InputError(
            f"expected 8 numbers (TUM), 12 or 16 (KITTI) or nanoseconds first (EuRoC), "
            f"got {columns} columns",
            file=path,
            field=f"line {line}",
        )
    raise InputError("expected a trajectory, found no row of numbers", file=path)


def read_tum(path: str | Path) -> Trajectory:
    """Read rows of ``timestamp tx ty tz qx qy qz qw``, with the time stamp in seconds."""
    return _stacked(iter_tum(path), path)


def iter_tum(path: str | Path, *, whole_lines: bool = False) -> Iterator[tuple[float, np.ndarray]]:
    """Time and pose (4, 4) of each row of a TUM file, one at a time.

    With ``whole_lines`` a last line without a line end is left out, because the program that wrote
    the file may have been killed within the line.
    """
    return _tum(Path(path), "xyzw", whole_lines)


def _tum(
    path: Path, order: QuaternionOrder, whole_lines: bool = False
) -> Iterator[tuple[float, np.ndarray]]:
    def parse(text: str) -> tuple[float, np.ndarray]:
        row = _numbers(_cells(text), 8, "timestamp tx ty tz qx qy qz qw")
        return row[0], _pose(_rotation(_xyzw(row[4:8], order)), row[1:4])

    return _stamped(path, parse, whole_lines)


def read_euroc(path: str | Path) -> Trajectory:
    """Read EuRoC's ground truth, ``t[ns],px,py,pz,qw,qx,qy,qz[,...]``: poses of the IMU."""
    return _stacked(_euroc(Path(path), "wxyz"), path)


def _euroc(path: Path, order: QuaternionOrder) -> Iterator[tuple[float, np.ndarray]]:
    def parse(text: str) -> tuple[float, np.ndarray]:
        cells = _cells(text)[:8]
        row = _numbers(cells, 8, "t[ns],px,py,pz,qw,qx,qy,qz")
        # A float rounds nanoseconds since 1970, by less than 1 us.
        seconds = _nanoseconds(cells[0]) / 1e9
        return seconds, _pose(_rotation(_xyzw(row[4:8], order)), row[1:4])

    return _stamped(path, parse)


def named_order(path: Path) -> QuaternionOrder | None:
    """Order of the quaternions by the names of the columns; None without names of qw and qx."""
    for _, w, x in _named_places(path):
        return "wxyz" if w < x else "xyzw"
    return None


def _named_places(path: Path) -> Iterator[tuple[int, int, int]]:
    """Number of columns and indices of qw and qx, for each line that names these columns."""
    for text in itertools.islice(_lines(path), _HEADER_LINES):
        names = [re.sub(r"[^a-z]", "", cell.lower()) for cell in _cells(text.lstrip("# "))]
        at = {
            axis: [k for k, name in enumerate(names) if re.fullmatch(f"q.*{axis}|q{axis}.*", name)]
            for axis in "wx"
        }
        if len(at["w"]) == len(at["x"]) == 1:
            yield len(names), at["w"][0], at["x"][0]


def _check_places(path: Path, columns: int) -> None:
    """Raise an InputError if a header of ``columns`` names has qw or qx in a wrong column.

    Counted from 1, (qw, qx) are expected in columns (5, 6), as in EuRoC files, or (8, 5), as in TUM
    files.
    """
    for named, w, x in _named_places(path):
        if named == columns and (w, x) not in ((4, 5), (7, 4)):
            raise InputError(
                f"by its names qw is column {w + 1} and qx column {x + 1}; expected time, "
                "position and quaternion, in this order",
                file=path,
            )


def _xyzw(quaternion: list[float], order: QuaternionOrder) -> np.ndarray:
    return np.array(quaternion if order == "xyzw" else [*quaternion[1:], quaternion[0]])


def read_kitti(path: str | Path) -> Trajectory:
    """Read one pose per line: a 3x4 or 4x4 matrix, written row by row."""
    path = Path(path)
    return Trajectory(timestamps=None, world_from_body=_stack(_kitti(path), path))


def _kitti(path: Path) -> Iterator[np.ndarray]:
    for line, text in _rows(path):
        try:
            cells = _cells(text)
            row = _numbers(cells, 16 if len(cells) == 16 else 12, "the rows of a 3x4 matrix")
            matrix = np.array(row[:12]).reshape(3, 4)
            _check_rotation(matrix[:, :3])
            if tuple(row[12:]) not in ((), _BOTTOM_ROW):
                raise ValueError(
                    "expected 0 0 0 1 as the last row of a 4x4 matrix, "
                    f"got {' '.join(map('{:g}'.format, row[12:]))}"
                )
            yield _pose(matrix[:, :3], matrix[:, 3])
        except ValueError as error:
            raise InputError(str(error), file=path, field=f"line {line}") from error


def write_tum(path: str | Path, trajectory: Trajectory) -> None:
    """Write rows of ``timestamp tx ty tz qx qy qz qw``, with all digits of each number."""
    if trajectory.timestamps is None:
        raise InputError("expected time stamps, which a TUM file needs", field="trajectory")
    rows = zip(trajectory.timestamps, trajectory.world_from_body, strict=True)
    Path(path).write_text("".join(tum_line(stamp, pose) for stamp, pose in rows))


def write_kitti(path: str | Path, trajectory: Trajectory) -> None:
    """Write one pose per line: a 3x4 matrix, row by row, without a time stamp."""
    Path(path).write_text("".join(map(kitti_line, trajectory.world_from_body)))


def tum_line(timestamp: float, world_from_body: np.ndarray) -> str:
    """One line of a TUM file, including the line end, for a pose (4, 4)."""
    quat_xyzw = so3.quat_xyzw_from_matrix(world_from_body[:3, :3])
    values = (timestamp, *world_from_body[:3, 3], *quat_xyzw)
    return " ".join(repr(float(value)) for value in values) + "\n"


def kitti_line(world_from_body: np.ndarray) -> str:
    """One line of a KITTI file, including the line end, for a pose (4, 4)."""
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
    stamps: list[float] = []

    def poses() -> Iterator[np.ndarray]:
        for stamp, pose in rows:
            stamps.append(stamp)
            yield pose

    stack = _stack(poses(), path)
    return Trajectory(timestamps=np.array(stamps), world_from_body=stack)


def _stack(poses: Iterator[np.ndarray], path: str | Path) -> np.ndarray:
    """Poses (N, 4, 4), stacked block by block.

    A list of single arrays would take twice the memory.
    """
    blocks, count = [], 0
    while block := list(itertools.islice(poses, _BLOCK)):
        blocks.append(np.stack(block))
        count += len(block)
        if count > _MOST_POSES:
            raise InputError(f"expected a trajectory of at most {_MOST_POSES} poses", file=path)
    if not blocks:
        raise InputError("expected a trajectory, found no row of numbers", file=path)
    return np.concatenate(blocks)


def _rows(path: Path, whole_lines: bool = False) -> Iterator[tuple[int, str]]:
    """Numbered lines of a file that are neither empty nor comments."""
    first = True
    for line, text in enumerate(_lines(path), start=1):
        if whole_lines and not text.endswith("\n"):
            return
        if not text.strip() or text.lstrip().startswith("#"):
            continue
        if not (first and _is_header(text)):
            yield line, text.strip()
        first = False


def _lines(path: Path) -> Iterator[str]:
    return regular_lines(path, limit_bytes=_LARGEST_BYTES, what="a trajectory")


def _cells(text: str) -> list[str]:
    """Columns of a line, separated by commas, semicolons, tabs or spaces."""
    return _SEPARATOR.split(text.strip().rstrip(",;").rstrip())


def _is_header(text: str) -> bool:
    """Whether a line is a header, because none of the cells is a number."""
    return not any(map(_is_number, _cells(text)))


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _has_nanoseconds(text: str, cells: list[str]) -> bool:
    """Whether a row is in EuRoC's format, with a whole number of nanoseconds in its first cell.

    This is the case if the number has 15 digits or more. A shorter number is nanoseconds if commas
    or semicolons separate the cells, and if there are not 12 or 16 cells as in KITTI files.
    """
    if not cells[0].isdecimal():
        return False
    parted = "," in text or ";" in text
    return len(cells[0]) >= _NANOSECOND_DIGITS or (parted and len(cells) not in (12, 16))


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
    if np.abs(R).max() > 1.0 + _UNIT_TOLERANCE:  # products of huge numbers overflow
        raise ValueError("expected a rotation matrix in the first three columns")
    off = float(np.abs(R @ R.T - np.eye(3)).max())
    if off > _UNIT_TOLERANCE or np.linalg.det(R) < 0.0:
        raise ValueError("expected a rotation matrix in the first three columns")


def _pose(R: np.ndarray, position: np.ndarray | list[float]) -> np.ndarray:
    if np.abs(position).max() > _MAX_POSITION:
        raise ValueError(f"expected positions of at most {_MAX_POSITION:g}")
    world_from_body = np.eye(4)
    world_from_body[:3, :3] = R
    world_from_body[:3, 3] = position
    return world_from_body
