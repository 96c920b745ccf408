"""Pose of a camera on a body: ``T_BS`` of EuRoC, ``T_cam_imu`` of Kalibr, or 16 numbers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from farpoint.camera.files.fields import Fields
from farpoint.camera.files.source import CalibrationFile
from farpoint.errors import InputError

__all__ = ["read_body_from_cam"]

_TOLERANCE = 1e-2  # files round rotations to as few as four digits
_BODY_FROM_CAM = ("T_BS", "T_imu_cam", "body_T_cam0", "T_b_c")
_CAM_FROM_BODY = ("T_cam_imu", "T_SB")


def read_body_from_cam(path: str | Path) -> np.ndarray:
    """Pose ``body_from_cam`` (4, 4) of a camera on a body.

    For a file with several cameras, the result is the pose of the first camera.

    Raises
    ------
    InputError
        If the file has no such pose, or if the pose is no rigid motion.
    """
    file = CalibrationFile.open(Path(path))
    numbers = file.text.replace(",", " ").split()
    try:
        return _checked(np.array(numbers, np.float64), file.path, None)
    except ValueError as error:
        if isinstance(error, InputError):
            raise
    groups = [file.fields]
    groups += [
        file.fields.group(key)
        for key, value in file.fields.values.items()
        if isinstance(value, Mapping) and key not in (*_BODY_FROM_CAM, *_CAM_FROM_BODY)
    ]
    for group in groups:
        if (key := group.first(*_BODY_FROM_CAM)) is not None:
            return _matrix(group, key)
        if (key := group.first(*_CAM_FROM_BODY)) is not None:
            return np.linalg.inv(_matrix(group, key))
    names = ", ".join((*_BODY_FROM_CAM, *_CAM_FROM_BODY))
    raise InputError(f"expected one of {names}, or the 16 numbers of a matrix", file=file.path)


def _matrix(fields: Fields, key: str) -> np.ndarray:
    return _checked(np.array(fields.numbers(key)), fields.file, fields.place(key))


def _checked(numbers: np.ndarray, file: Path, field: str | None) -> np.ndarray:
    if numbers.size not in (12, 16):
        raise InputError(f"expected 12 or 16 numbers, got {numbers.size}", file=file, field=field)
    matrix = np.eye(4)
    matrix[: numbers.size // 4] = numbers.reshape(-1, 4)
    R = matrix[:3, :3]
    rigid = np.isfinite(matrix).all() and np.abs(matrix).max() < 1e9
    if not (
        rigid
        and np.abs(R @ R.T - np.eye(3)).max() < _TOLERANCE
        and np.linalg.det(R) > 0.0
        and np.array_equal(matrix[3], [0, 0, 0, 1])
    ):
        raise InputError(
            "expected a rigid motion, a rotation beside a position", file=file, field=field
        )
    return matrix
