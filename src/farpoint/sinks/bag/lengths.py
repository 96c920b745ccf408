"""Lengths of motions: in metres from aiding measurements, or in the unit of the path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from farpoint.aiding import MetricEstimate
from farpoint.odometry import OdometryResult
from farpoint.sinks.metric_files import metric_covariance

__all__ = ["UNKNOWN_SPEED", "Length", "MetricPath", "length_in_metres", "length_in_units"]

UNKNOWN_SPEED = 1000.0
"""1-sigma of an unknown speed, m/s; so large that a filter ignores the speed."""

_FASTEST = 30.0
"""Speed, m/s. Times the duration of a motion of unknown length, it is the least `Length.lever`."""

_LOST_M2, _LOST_RAD2 = 1e6, np.pi**2  # variances of an unknown position and orientation


@dataclass(frozen=True, kw_only=True)
class Length:
    """Length of one motion.

    Attributes
    ----------
    value : float
        Most likely length of the motion.
    sigma : float
        1-sigma of ``value``.
    lever : float
        Length by which errors of direction and rotation are multiplied to errors of the
        translation; at least ``value``.
    """

    value: float
    sigma: float
    lever: float


def length_in_units(result: OdometryResult, seconds: float) -> Length:
    """Length of a motion in the unit of the path; unknown if the path has no scale."""
    if result.scale is None:
        return _unknown(0.0, seconds)
    return Length(value=result.scale, sigma=result.scale_sigma or 0.0, lever=result.scale)


def length_in_metres(
    result: OdometryResult, metres: MetricEstimate | None, seconds: float
) -> Length:
    """Length of a motion in metres; unknown without an aiding measurement or a scale."""
    if result.scale is None or metres is None:
        return _unknown(result.scale or 0.0, seconds)
    factor = metres.metres_per_unit
    value = factor * result.scale
    sigma = float(np.hypot(factor * (result.scale_sigma or 0.0), metres.sigma * value))
    return Length(value=value, sigma=sigma, lever=value)


def _unknown(value: float, seconds: float) -> Length:
    lever = max(value, _FASTEST * seconds)
    return Length(value=value, sigma=UNKNOWN_SPEED * seconds, lever=lever)


class MetricPath:
    """Poses during a run. Lengths are in metres after the first estimate of the metric scale.

    Parameters
    ----------
    metres : callable or None
        Returns the current estimate of metres per unit. Without aiding measurements the argument is
        None, and lengths are in the unit of the path.
    """

    def __init__(self, metres: Callable[[], MetricEstimate | None] | None) -> None:
        self._metres = metres
        self._position = np.zeros(3)
        self._last = np.zeros(3)  # in the unit of the path
        self._is_metric = False
        self._segment = 0
        self._lost = np.zeros((7, 7))

    @property
    def estimate(self) -> MetricEstimate | None:
        """Metres per unit; None if unknown."""
        return None if self._metres is None else self._metres()

    def add(self, result: OdometryResult) -> tuple[np.ndarray, np.ndarray]:
        """Pose (4, 4) ``world_from_cam`` and covariance (7, 7) in the format of `OdometryResult`.

        After a break of the path the pose is unknown, so the covariance is very large.
        """
        pose, now = result.world_from_cam.copy(), self.estimate
        place = pose[:3, 3].copy()
        if now is None:
            self._position = self._position + (place - self._last)
        elif not self._is_metric:
            self._position, self._is_metric = now.metres_per_unit * place, True
        else:
            self._position = self._position + now.metres_per_unit * (place - self._last)
        self._last = place
        pose[:3, 3] = self._position
        return pose, self._covariance(result, now) + self._lost_since(result)

    def _covariance(self, result: OdometryResult, now: MetricEstimate | None) -> np.ndarray:
        covariance = result.world_covariance
        if covariance is None:
            return np.diag([_LOST_RAD2] * 3 + [_LOST_M2] * 3 + [0.0])
        if now is not None:
            return metric_covariance(covariance, self._position, now.metres_per_unit, now.sigma)
        if self._metres is not None:  # no reading of an aiding measurement yet
            return covariance + np.diag([0.0] * 3 + [_LOST_M2] * 3 + [0.0])
        return covariance

    def _lost_since(self, result: OdometryResult) -> np.ndarray:
        if result.segment != self._segment:
            self._segment = result.segment
            self._lost[3:6, 3:6] = _LOST_M2 * np.eye(3)
            if result.pose is None or result.pose.rotation_cam1_from_cam0 is None:
                self._lost[:3, :3] = _LOST_RAD2 * np.eye(3)
        return self._lost
