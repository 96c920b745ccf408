"""Readings of the metric scale during a run, from aiding measurements and odometry results."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from farpoint.aiding.ground import find_ground
from farpoint.aiding.kinds import (
    AidingMeasurement,
    CameraHeight,
    GnssPositions,
    KnownDistance,
    KnownSpeed,
)
from farpoint.aiding.readings import Reading
from farpoint.camera import Camera
from farpoint.odometry import OdometryResult

__all__ = ["Accumulator", "accumulator_for"]

_WINDOW_S = 1.0  # averaging time of a reading: errors over shorter times are correlated
_LEAST_SPEED = 0.5  # m/s: below, the error of a speed is not proportional to the speed
_LEAST_SIGMA = 0.002  # least relative 1-sigma of a reading
_GNSS_SIGMAS = 10.0  # least distance between two compared positions, in sigma of a coordinate
_HEIGHT_SIGMA = 0.05  # relative 1-sigma of a reading of the height, because no road is a plane


class Accumulator(Protocol):
    """Accumulates the results of a run into readings of the scale."""

    def add(self, camera: Camera, result: OdometryResult) -> list[Reading]:
        """Add a result, and return the readings that this result completes."""
        ...


def accumulator_for(measurement: AidingMeasurement) -> Accumulator:
    """Accumulator for a kind of aiding measurement."""
    match measurement:
        case KnownSpeed():
            return _Speeds(measurement)
        case CameraHeight():
            return _Heights(measurement)
        case KnownDistance():
            return _Distance(measurement)
        case GnssPositions():
            return _Gnss(measurement)


@dataclass
class _Window:
    """Sums over a time window within one segment."""

    segment: int = 0
    start_s: float = 0.0
    seconds: float = 0.0
    metres: float = 0.0
    metres_variance: float = 0.0
    units: float = 0.0
    variance: float = 0.0


class _Speeds:
    """Readings of one second each: distance by the speeds, m, divided by length of the path."""

    def __init__(self, measurement: KnownSpeed) -> None:
        self._measurement = measurement
        self._window = _Window()

    def add(self, camera: Camera, result: OdometryResult) -> list[Reading]:
        """Add a result. Each second at 0.5 m/s or more within one segment gives a reading."""
        del camera
        middle_s = 0.5 * (result.timestamp0 + result.timestamp)
        speed = self._at(middle_s, self._measurement.speeds)
        if result.scale is None or speed is None or speed < _LEAST_SPEED:
            return []
        window = self._window
        if window.segment != result.segment or not window.seconds:
            window = _Window(segment=result.segment, start_s=result.timestamp0)
        seconds = result.timestamp - result.timestamp0
        window.seconds += seconds
        window.metres += speed * seconds
        if self._measurement.sigmas_mps is not None:
            sigma = self._at(middle_s, self._measurement.sigmas_mps) or 0.0
            window.metres_variance += (sigma * seconds) ** 2
        window.units += result.scale
        window.variance += _own_variance(result)
        self._window = window
        if window.seconds < _WINDOW_S:
            return []
        self._window = _Window()
        if window.units <= 0.0:
            return []
        visual = window.variance / window.units**2
        own = self._measurement.sigma**2
        if self._measurement.sigmas_mps is not None:
            own = window.metres_variance / window.metres**2
        reading = Reading(
            kind="speed",
            start_s=window.start_s,
            end_s=result.timestamp,
            segment=result.segment,
            log_ratio=math.log(window.metres / window.units),
            sigma=math.sqrt(own + visual + _LEAST_SIGMA**2),
            shared_sigma=self._measurement.sigma,
            drift=_drift(result),
        )
        return [reading]

    def _at(self, time_s: float, values: np.ndarray) -> float | None:
        times = self._measurement.timestamps_s
        if not times[0] <= time_s <= times[-1]:
            return None
        return float(np.interp(time_s, times, values))


class _Heights:
    """Readings of one second each: known height, m, divided by the estimated camera height."""

    def __init__(self, measurement: CameraHeight) -> None:
        self._measurement = measurement
        self._logs: list[float] = []
        self._segment, self._start_s = 0, 0.0

    def add(self, camera: Camera, result: OdometryResult) -> list[Reading]:
        """Add a result. Each second in a segment with the ground in view gives a reading."""
        height = find_ground(camera, result)
        if height is None:
            return []
        if not self._logs or self._segment != result.segment:
            self._logs, self._segment, self._start_s = [], result.segment, result.timestamp0
        self._logs.append(math.log(height))
        if result.timestamp - self._start_s < _WINDOW_S:
            return []
        logs, self._logs = np.array(self._logs), []
        deviation = 1.4826 * float(np.median(np.abs(logs - np.median(logs))))
        reading = Reading(
            kind="height",
            start_s=self._start_s,
            end_s=result.timestamp,
            segment=result.segment,
            log_ratio=math.log(self._measurement.height_m) - float(np.median(logs)),
            sigma=math.hypot(_HEIGHT_SIGMA, deviation),
            shared_sigma=self._measurement.sigma,
            drift=_drift(result),
        )
        return [reading]


class _Distance:
    """The reading from one known distance between two frames."""

    def __init__(self, measurement: KnownDistance) -> None:
        self._measurement = measurement
        self._begin: OdometryResult | None = None

    def add(self, camera: Camera, result: OdometryResult) -> list[Reading]:
        """Add a result. The second frame gives the reading if both frames are in one segment."""
        del camera
        if result.frame1 == self._measurement.frame0:
            self._begin = result
        begin = self._begin
        if (
            result.frame1 != self._measurement.frame1
            or begin is None
            or begin.segment != result.segment
        ):
            return []
        distance = _distance_between(begin, result)
        if distance <= 0.0:
            return []
        reading = Reading(
            kind="distance",
            start_s=begin.timestamp,
            end_s=result.timestamp,
            segment=result.segment,
            log_ratio=math.log(self._measurement.distance_m / distance),
            sigma=math.hypot(self._measurement.sigma, _LEAST_SIGMA),
            shared_sigma=0.0,
            drift=0.5 * (_drift(begin) + _drift(result)),
        )
        return [reading]


class _Gnss:
    """Readings from distances between positions that are at least 10 sigma apart."""

    def __init__(self, measurement: GnssPositions) -> None:
        self._measurement = measurement
        self._next = 0
        self._last: OdometryResult | None = None
        self._begin: tuple[int, float, np.ndarray] | None = None  # segment, time, position
        self._begin_m, self._begin_sigma_m = np.zeros(3), 0.0

    def add(self, camera: Camera, result: OdometryResult) -> list[Reading]:
        """Add a result. Each position far enough from the last used position gives a reading."""
        del camera
        last, self._last = self._last, result
        times, readings = self._measurement.timestamps_s, []
        while self._next < len(times) and times[self._next] <= result.timestamp:
            time_s, fix = float(times[self._next]), self._measurement.positions_m[self._next]
            sigmas = self._measurement.sigmas_m
            sigma_m = self._measurement.sigma_m if sigmas is None else float(sigmas[self._next])
            self._next += 1
            if last is None or last.segment != result.segment or time_s < last.timestamp:
                if last is not None or time_s < result.timestamp:
                    continue
                place = result.world_from_cam[:3, 3]
            else:
                share = (time_s - last.timestamp) / (result.timestamp - last.timestamp)
                before, after = last.world_from_cam[:3, 3], result.world_from_cam[:3, 3]
                place = before + share * (after - before)
            reading = self._compare(result, time_s, place, fix, sigma_m)
            readings += [] if reading is None else [reading]
        return readings

    def _compare(
        self,
        result: OdometryResult,
        time_s: float,
        place: np.ndarray,
        fix: np.ndarray,
        sigma_m: float,
    ) -> Reading | None:
        if self._begin is None or self._begin[0] != result.segment:
            self._begin, self._begin_m = (result.segment, time_s, place), fix
            self._begin_sigma_m = sigma_m
            return None
        metres = float(np.linalg.norm(fix - self._begin_m))
        units = float(np.linalg.norm(place - self._begin[2]))
        both_m = math.hypot(self._begin_sigma_m, sigma_m)
        if metres < _GNSS_SIGMAS * max(self._begin_sigma_m, sigma_m) or units <= 0.0:
            return None
        start_s = self._begin[1]
        self._begin, self._begin_m = (result.segment, time_s, place), fix
        self._begin_sigma_m = sigma_m
        return Reading(
            kind="gnss",
            start_s=start_s,
            end_s=time_s,
            segment=result.segment,
            log_ratio=math.log(metres / units),
            sigma=math.hypot(both_m / metres, _LEAST_SIGMA),
            shared_sigma=0.0,
            drift=_drift(result),
        )


def _distance_between(begin: OdometryResult, end: OdometryResult) -> float:
    return float(np.linalg.norm(end.world_from_cam[:3, 3] - begin.world_from_cam[:3, 3]))


def _drift(result: OdometryResult) -> float:
    """Variance of the logarithm of the scale since the beginning of the segment."""
    return 0.0 if result.world_covariance is None else float(result.world_covariance[6, 6])


def _own_variance(result: OdometryResult) -> float:
    """Variance of the length of one translation, without the part due to the error of the scale."""
    assert result.scale is not None
    sigma = result.scale_sigma or 0.0
    return max(sigma**2 - result.scale**2 * _drift(result), 0.0)
