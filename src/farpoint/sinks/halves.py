"""``halves.csv``: results of the split-half tests, written during the run."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from farpoint.errors import InputError
from farpoint.metrics import SplitHalf
from farpoint.odometry import OdometryResult
from farpoint.pose import PoseStatus
from farpoint.sinks.claims import check_covariance, check_size
from farpoint.sinks.sink import TextFile

__all__ = ["COLUMNS", "HalvesFile", "read_halves"]

_UPPER_TRIANGLE = np.triu_indices(5)

COLUMNS = (
    "timestamp0", "timestamp1", "frame0", "frame1", "status_a", "status_b", "dof", "nees",
    "dtheta_x", "dtheta_y", "dtheta_z", "dbeta_0", "dbeta_1",
    *(f"cov_{row}{column}" for row, column in zip(*_UPPER_TRIANGLE, strict=True)),
)  # fmt: skip
"""The header of the file."""

_STATUSES = slice(COLUMNS.index("status_a"), COLUMNS.index("status_b") + 1)
_DIFFERENCE = slice(COLUMNS.index("dtheta_x"), COLUMNS.index("dbeta_1") + 1)
_COVARIANCE = slice(COLUMNS.index("cov_00"), len(COLUMNS))


class HalvesFile(TextFile):
    """Writer of a row for each test: the difference of two estimates, with a covariance."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, header=",".join(COLUMNS) + "\n")

    def write(self, result: OdometryResult, halves: SplitHalf) -> None:
        """Append the test of one pair."""
        dof = halves.dof
        difference, covariance = np.full(5, np.nan), np.full((5, 5), np.nan)
        difference[:dof], covariance[:dof, :dof] = halves.difference, halves.covariance
        numbers = [halves.nees, *difference, *covariance[_UPPER_TRIANGLE]]
        cells = [
            repr(float(result.timestamp0)),
            repr(float(result.timestamp)),
            str(result.frame0),
            str(result.frame1),
            *(status.value for status in halves.statuses),
            str(dof),
            *("" if math.isnan(value) else repr(float(value)) for value in numbers),
        ]
        self._put(",".join(cells) + "\n")


def read_halves(path: str | Path) -> list[SplitHalf]:
    """Read a ``halves.csv``. An incomplete last line is left out.

    Raises
    ------
    InputError
        If the file is invalid; the message has the file, the line and the expected value.
    """
    path = Path(path)
    try:
        lines = path.read_text(encoding="utf-8").split("\n")[:-1]
    except UnicodeDecodeError as error:
        raise InputError("expected a text file of split-half tests", file=path) from error
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from error
    if not lines or lines[0].split(",") != list(COLUMNS):
        raise InputError("expected the columns of halves.csv", file=path, field="line 1")
    found = []
    for number, text in enumerate(lines[1:], start=2):
        try:
            found.append(_parsed(text.split(",")))
        except ValueError as error:
            raise InputError(str(error), file=path, field=f"line {number}") from error
    return found


def _parsed(cells: list[str]) -> SplitHalf:
    if len(cells) != len(COLUMNS):
        raise ValueError(f"expected {len(COLUMNS)} columns, got {len(cells)}")
    first, second = (PoseStatus(cell) for cell in cells[_STATUSES])
    difference = np.array([float(cell or "nan") for cell in cells[_DIFFERENCE]])
    covariance = np.empty((5, 5))
    covariance[_UPPER_TRIANGLE] = [float(cell or "nan") for cell in cells[_COVARIANCE]]
    covariance.T[_UPPER_TRIANGLE] = covariance[_UPPER_TRIANGLE]
    check_size(difference[np.isfinite(difference)])  # opposite directions differ infinitely
    dof = int(cells[COLUMNS.index("dof")])
    if dof not in (0, 3, 5) or np.isnan(difference[:dof]).any():
        raise ValueError(f"expected dof 0, 3 or 5 and as many differences, got dof {dof}")
    check_covariance(covariance[:dof, :dof])
    if np.isnan(covariance[:dof, :dof]).any():
        raise ValueError(f"expected the covariance of {dof} differences")
    return SplitHalf(
        statuses=(first, second), difference=difference[:dof], covariance=covariance[:dof, :dof]
    )
