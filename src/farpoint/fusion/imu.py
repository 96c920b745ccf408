"""IMU measurements (angular rates and specific forces) and the noise of an IMU."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from farpoint.errors import InputError
from farpoint.frames.bags import open_bag, rows_of
from farpoint.options import coerce_positive
from farpoint.regular_files import regular_lines

_LARGEST_BYTES = 1 << 30
_MOST_ROWS = 8_000_000  # 11 hours at 200 measurements per second
_LARGEST = 1e12  # of a time, an angular rate or a specific force, so that products do not overflow

__all__ = ["ImuNoise", "ImuSamples", "ImuSteps", "read_bag_imu", "read_euroc_imu"]


@dataclass(frozen=True, kw_only=True)
class ImuNoise:
    """Noise of an IMU, in the terms of Kalibr and of EuRoC's ``sensor.yaml``.

    Attributes
    ----------
    gyro_density : float
        White noise of the angular rate, rad/s/sqrt(Hz).
    gyro_walk : float
        Random walk of the gyroscope's bias, rad/s^2/sqrt(Hz).
    accel_density : float
        White noise of the specific force, m/s^2/sqrt(Hz).
    accel_walk : float
        Random walk of the accelerometer's bias, m/s^3/sqrt(Hz).

    Raises
    ------
    InputError
        If a field is not positive.
    """

    gyro_density: float = 1.7e-4
    gyro_walk: float = 2.0e-5
    accel_density: float = 2.0e-3
    accel_walk: float = 3.0e-3

    def __post_init__(self) -> None:
        coerce_positive(self, *(field.name for field in fields(self)))


@dataclass(frozen=True, kw_only=True, eq=False)
class ImuSteps:
    """Consecutive time steps, each with its mean measurement.

    Attributes
    ----------
    gyro : ndarray, shape (N, 3)
        Mean angular rate, rad/s. The shape is (..., N, 3) for a stack of measurements.
    accel : ndarray, shape (N, 3)
        Mean specific force, m/s^2. The shape is that of ``gyro``.
    dt : ndarray, shape (N,)
        Lengths of the steps, s.
    """

    gyro: np.ndarray
    accel: np.ndarray
    dt: np.ndarray

    def __len__(self) -> int:
        return len(self.dt)

    def parts(self, size: int) -> Iterator[ImuSteps]:
        """The same steps in parts of at most ``size`` steps."""
        for k in range(0, len(self), size):
            part = slice(k, k + size)
            yield ImuSteps(gyro=self.gyro[part], accel=self.accel[part], dt=self.dt[part])


@dataclass(frozen=True, kw_only=True, eq=False)
class ImuSamples:
    """Measurements of an IMU in its own axes.

    Attributes
    ----------
    timestamps : ndarray, shape (N,)
        Seconds, increasing.
    gyro : ndarray, shape (N, 3)
        Angular rate of the IMU relative to the world, rad/s.
    accel : ndarray, shape (N, 3)
        Specific force, m/s^2. At rest the specific force points up and has the magnitude of
        gravity.

    Raises
    ------
    InputError
        If shapes differ, if times do not increase, or if a number is not finite.
    """

    timestamps: np.ndarray
    gyro: np.ndarray
    accel: np.ndarray

    def __post_init__(self) -> None:
        n = len(self.timestamps)
        for name in ("gyro", "accel"):
            values = getattr(self, name)
            if values.shape != (n, 3) or not np.isfinite(values).all():
                raise InputError(f"expected ({n}, 3) finite numbers", field=name)
        if n < 2 or not (np.diff(self.timestamps) > 0.0).all():
            raise InputError("expected at least 2, increasing", field="timestamps")

    def between(self, start_s: float, end_s: float) -> ImuSteps:
        """The steps that lead from one time to another.

        Measurements are interpolated linearly, so steps may begin and end between two measurements.

        Raises
        ------
        InputError
            If the samples do not cover the whole interval.
        """
        t = self.timestamps
        if not t[0] <= start_s <= end_s <= t[-1]:
            raise InputError(
                f"expected samples from {start_s} to {end_s} s, got {t[0]} to {t[-1]} s",
                field="timestamps",
            )
        times = np.unique([start_s, *t[(t > start_s) & (t < end_s)], end_s])
        values = np.hstack([self.gyro, self.accel])
        at = np.column_stack([np.interp(times, t, column) for column in values.T])
        gyro, accel = np.hsplit(0.5 * (at[1:] + at[:-1]), 2)
        return ImuSteps(gyro=gyro, accel=accel, dt=np.diff(times))


def read_euroc_imu(path: str | Path) -> ImuSamples:
    """Read EuRoC's ``imu0/data.csv``: ``t[ns],wx,wy,wz,ax,ay,az``, rad/s and m/s^2.

    Raises
    ------
    InputError
        If the file is invalid. The message has the file and the line.
    """
    path = Path(path)
    stamps, rows = array("d"), array("d")
    lines = regular_lines(path, limit_bytes=_LARGEST_BYTES, what="measurements of an IMU")
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.startswith("#"):
            continue
        cells = line.split(",")
        try:
            nanoseconds, *values = int(cells[0]), *map(float, cells[1:])
            sizes = map(abs, (nanoseconds / 1e9, *values))
            if len(values) != 6 or not all(size <= _LARGEST for size in sizes):
                raise ValueError
        except (ValueError, OverflowError):
            raise InputError(
                f"expected t[ns] and 6 numbers of at most {_LARGEST:g}, with commas",
                file=path,
                field=f"line {number}",
            ) from None
        stamps.append(nanoseconds / 1e9)
        rows.extend(values)
        if len(stamps) > _MOST_ROWS:
            raise InputError(f"expected at most {_MOST_ROWS} measurements", file=path)
    table = np.array(rows).reshape(-1, 6)
    try:
        return ImuSamples(timestamps=np.array(stamps), gyro=table[:, :3], accel=table[:, 3:])
    except InputError as error:
        raise InputError(error.problem, file=path, field=error.field) from error


def read_bag_imu(path: str | Path, topic: str) -> ImuSamples:
    """Read the ``sensor_msgs/Imu`` messages of a topic of a bag. Damaged messages are skipped.

    Raises
    ------
    InputError
        If the bag cannot be read, has no such topic, or has too few samples.
    """
    rows = rows_of(
        open_bag(Path(path)), topic, frozenset({"Imu"}), _sample, "an IMU", field="topic"
    )
    table = np.array(rows).reshape(-1, 7)
    try:
        return ImuSamples(timestamps=table[:, 0], gyro=table[:, 1:4], accel=table[:, 4:])
    except InputError as error:
        raise InputError(error.problem, file=path, field=error.field) from error


def _sample(message: Any) -> tuple[float, ...]:
    vectors = (message.angular_velocity, message.linear_acceleration)
    return tuple(float(getattr(vector, axis)) for vector in vectors for axis in "xyz")
