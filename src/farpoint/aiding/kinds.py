"""Kinds of aiding measurements, with the 1-sigma of their errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint.errors import InputError
from farpoint.options import coerce_positive

__all__ = ["AidingMeasurement", "CameraHeight", "GnssPositions", "KnownDistance", "KnownSpeed"]


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownSpeed:
    """Speeds with time stamps, such as wheel speeds.

    Attributes
    ----------
    timestamps_s : ndarray, shape (N,)
        Times, s, ascending, on the clock of the frames.
    speeds : ndarray, shape (N,)
        Speeds, m/s, without sign.
    sigma : float
        Relative 1-sigma of two errors: the independent error of the mean speed over each second,
        and the error common to all speeds, such as that of a wheel's diameter.
    sigmas_mps : ndarray, shape (N,), or None
        1-sigma of the independent error of each speed, m/s. If given, ``sigma`` applies only to the
        error common to all speeds.
    """

    timestamps_s: np.ndarray
    speeds: np.ndarray
    sigma: float = 0.02
    sigmas_mps: np.ndarray | None = None

    def __post_init__(self) -> None:
        _check_table(self.timestamps_s, self.speeds, "speeds", ())
        if (np.asarray(self.speeds) < 0.0).any():
            raise InputError("expected 0 or more", field="speeds")
        if self.sigmas_mps is not None:
            _check_table(self.timestamps_s, self.sigmas_mps, "sigmas_mps", ())
        coerce_positive(self, "sigma")


@dataclass(frozen=True, kw_only=True)
class CameraHeight:
    """Height of the camera over flat ground in view. The camera must be approximately upright.

    Attributes
    ----------
    height_m : float
        Height, m; positive.
    sigma : float
        Relative 1-sigma of the height.
    """

    height_m: float
    sigma: float = 0.05

    def __post_init__(self) -> None:
        coerce_positive(self, "height_m", "sigma")


@dataclass(frozen=True, kw_only=True)
class KnownDistance:
    """Distance between the positions of the camera at two frames.

    Attributes
    ----------
    frame0, frame1 : int
        Indices of the two frames, the earlier first.
    distance_m : float
        Straight-line distance between the two positions, m.
    sigma : float
        Relative 1-sigma of the distance.
    """

    frame0: int
    frame1: int
    distance_m: float
    sigma: float = 0.02

    def __post_init__(self) -> None:
        if not 0 <= self.frame0 < self.frame1:
            raise InputError(
                f"expected two frames, the earlier first, got {self.frame0} and {self.frame1}",
                field="frame0",
            )
        coerce_positive(self, "distance_m", "sigma")


@dataclass(frozen=True, kw_only=True, eq=False)
class GnssPositions:
    """Positions with time stamps, in any fixed axes, used only to find the scale.

    Attributes
    ----------
    timestamps_s : ndarray, shape (N,)
        Times, s, ascending, on the clock of the frames.
    positions_m : ndarray, shape (N, 3)
        Positions of the antenna, m. If the antenna is not near the camera, rotations of the vehicle
        cause an error.
    sigma_m : float
        1-sigma of each coordinate, m. Positions are compared only if they are at least 10 sigma
        apart; the errors of such positions are taken as independent.
    sigmas_m : ndarray, shape (N,), or None
        1-sigma of the coordinates of each position, m, in place of ``sigma_m``.
    """

    timestamps_s: np.ndarray
    positions_m: np.ndarray
    sigma_m: float = 2.0
    sigmas_m: np.ndarray | None = None

    def __post_init__(self) -> None:
        _check_table(self.timestamps_s, self.positions_m, "positions_m", (3,))
        if self.sigmas_m is not None:
            _check_table(self.timestamps_s, self.sigmas_m, "sigmas_m", ())
        coerce_positive(self, "sigma_m")


AidingMeasurement = KnownSpeed | CameraHeight | KnownDistance | GnssPositions


def _check_table(times: np.ndarray, values: np.ndarray, name: str, rest: tuple[int, ...]) -> None:
    times, values = np.asarray(times), np.asarray(values)
    if times.ndim != 1 or len(times) < 2 or not (np.diff(times) > 0.0).all():
        raise InputError("expected 2 or more ascending times", field="timestamps_s")
    if values.shape != (len(times), *rest) or not np.isfinite(values).all():
        raise InputError(
            f"expected finite numbers of shape {(len(times), *rest)}, got {values.shape}",
            field=name,
        )
