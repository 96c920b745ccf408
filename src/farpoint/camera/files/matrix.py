"""Camera matrices: focal lengths and principal point from nine or twelve numbers."""

from __future__ import annotations

from typing import TypedDict

import numpy as np

from farpoint.camera.files.fields import Fields

__all__ = [
    "NAMED",
    "Intrinsics",
    "intrinsics_by_name",
    "intrinsics_from_matrix",
    "skew_of_matrix",
]

NAMED = ("fx", "fy", "cx", "cy")

_SHORTEST_PX = 4.0  # a smaller fx may be relative to the width of the image


class Intrinsics(TypedDict):
    """Focal lengths and principal point, px."""

    fx: float
    fy: float
    cx: float
    cy: float


def intrinsics_from_matrix(
    fields: Fields, key: str, *, columns: int = 3, skewed: bool = False
) -> Intrinsics:
    """Focal lengths and principal point of a camera matrix, 3x3, or 3x4 for rectified images.

    Raises
    ------
    InputError
        If the numbers are no camera matrix: a wrong count, a skew (unless `skewed`), or a last row
        other than 0 0 1.
    """
    matrix = np.reshape(fields.numbers(key, (3 * columns,)), (3, columns))[:, :3]
    skew = matrix[0, 1] if skewed else 0.0
    expected = np.array(
        [[matrix[0, 0], skew, matrix[0, 2]], [0, matrix[1, 1], matrix[1, 2]], [0, 0, 1]]
    )
    if np.abs(matrix - expected).max() > 1e-6:
        rows = "; ".join(" ".join(f"{value:g}" for value in row) for row in matrix)
        raise fields.error(key, f"expected a matrix fx 0 cx; 0 fy cy; 0 0 1, got {rows}")
    found = Intrinsics(
        fx=float(matrix[0, 0]),
        fy=float(matrix[1, 1]),
        cx=float(matrix[0, 2]),
        cy=float(matrix[1, 2]),
    )
    _refuse_shares(fields, key, found)
    return found


def intrinsics_by_name(fields: Fields) -> Intrinsics:
    """Focal lengths and principal point in fields ``fx fy cx cy``."""
    fx, fy, cx, cy = (fields.number(key) for key in NAMED)
    found = Intrinsics(fx=fx, fy=fy, cx=cx, cy=cy)
    _refuse_shares(fields, NAMED[0], found)
    return found


def _refuse_shares(fields: Fields, key: str, found: Intrinsics) -> None:
    if found["fx"] < _SHORTEST_PX and 0.0 < max(found["cx"], found["cy"]) <= 1.0:
        raise fields.error(key, "is in shares of the image; expected pixels")


def skew_of_matrix(fields: Fields, key: str) -> float:
    """The skew, which is the second number of a 3x3 camera matrix, px."""
    return fields.numbers(key, (9,))[1]
