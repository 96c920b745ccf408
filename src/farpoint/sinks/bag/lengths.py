"""How long motions are, as far as it is known: in metres by hints, or in the path's own unit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from farpoint.aiding import MetricEstimate
from farpoint.odometry import OdometryResult
from farpoint.sinks.metric_files import metric_covariance

__all__ = ["UNKNOWN_SPEED", "Length", "MetricPath", "length_in_metres", "length_in_units"]

UNKNOWN_SPEED = 1000.0
"""1-sigma of a speed that is not known, m/s: a filter that knows anything of it ignores that."""

_FASTEST = 30.0
"""m/s: by it an error of the direction counts where the speed is not known."""

_LOST_M2, _LOST_RAD2 = 1e6, np.pi**2  # variances behind a break of the path


@dataclass(frozen=True, kw_only=True)
class Length:
    """Length of one motion.

    Attributes
    ----------
    value : float
        Its most likely length.
    sigma : float
        1-sigma of it.
    lever : float
        The length by which errors of the direction and the rotation count: not less than that.
    """

    value: float
    sigma: float
    lever: float


def length_in_units(result: OdometryResult, seconds: float) -> Length:
    """In the unit of the path; unknown where the path has no scale."""
    if result.scale is None:
        return _unknown(0.0, seconds)
    return Length(value=result.scale, sigma=result.scale_sigma or 0.0, lever=result.scale)


def length_in_metres(
    result: OdometryResult, metres: MetricEstimate | None, seconds: float
) -> Length:
    """In metres; unknown without an aiding measurement or a scale."""
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
    """Poses of a run as it goes on: in metres from the first estimate of the scale on.

    Parameters
    ----------
    metres : callable or None
        Gives the estimate of now; None where no hint is given: then lengths keep the path's unit.
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
        """Metres for a unit, as far as it is known."""
        return None if self._metres is None else self._metres()

    def add(self, result: OdometryResult) -> tuple[np.ndarray, np.ndarray]:
        """Pose (4, 4) ``world_from_cam`` and covariance (7, 7) as `OdometryResult` has them.

        Behind a break of the path nothing is known of where it goes on: the covariances say so.
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
        if self._metres is not None:  # a hint that has not spoken yet
            return covariance + np.diag([0.0] * 3 + [_LOST_M2] * 3 + [0.0])
        return covariance

    def _lost_since(self, result: OdometryResult) -> np.ndarray:
        if result.segment != self._segment:
            self._segment = result.segment
            self._lost[3:6, 3:6] = _LOST_M2 * np.eye(3)
            if result.pose is None or result.pose.rotation_cam1_from_cam0 is None:
                self._lost[:3, :3] = _LOST_RAD2 * np.eye(3)
        return self._lost
