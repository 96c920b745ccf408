"""The metric scale: estimated during a run, and smoothed over the whole run at its end."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

from farpoint.aiding.gathering import accumulator_for
from farpoint.aiding.kinds import AidingMeasurement
from farpoint.aiding.readings import Reading
from farpoint.aiding.smoothing import MetricFit, fit_readings
from farpoint.camera import Camera
from farpoint.odometry import OdometryResult

__all__ = ["MetricEstimate", "MetricScale"]

_RECENT = 120  # number of last readings from which `MetricScale.add` estimates the current scale


@dataclass(frozen=True, kw_only=True)
class MetricEstimate:
    """Length, in metres, of a unit of the trajectory.

    Attributes
    ----------
    metres_per_unit : float
        Positive.
    sigma : float
        1-sigma of the logarithm of ``metres_per_unit``.
    """

    metres_per_unit: float
    sigma: float


class MetricScale:
    """Compares the results of `Odometry` with aiding measurements.

    Parameters
    ----------
    measurements : iterable of AidingMeasurement
        `KnownSpeed`, `CameraHeight`, `KnownDistance` or `GnssPositions`. All readings of one kind
        share one error in addition to independent errors.

    Attributes
    ----------
    readings : list of Reading
        All readings so far. Speeds and heights give at most one reading per second.

    Examples
    --------
    >>> odometry = Odometry(camera)  # doctest: +SKIP
    >>> metric = MetricScale([CameraHeight(height_m=1.65)])  # doctest: +SKIP
    >>> for result in odometry.run(open_frames("drive.mp4")):  # doctest: +SKIP
    ...     now = metric.add(odometry.camera, result)
    >>> metric.fit().at(12.0, segment=0)  # doctest: +SKIP
    """

    def __init__(self, measurements: Iterable[AidingMeasurement]) -> None:
        self._gatherers = [accumulator_for(measurement) for measurement in measurements]
        self._recent: deque[Reading] = deque(maxlen=_RECENT)
        self._now: MetricEstimate | None = None
        self.readings: list[Reading] = []

    def add(self, camera: Camera, result: OdometryResult) -> MetricEstimate | None:
        """Add the next result, and return the current scale, or None before the first reading."""
        new = [reading for gatherer in self._gatherers for reading in gatherer.add(camera, result)]
        if new:
            self.readings += new
            self._recent.extend(new)
            fit = fit_readings(list(self._recent))
            metres, sigma = fit.at(result.timestamp, result.segment)
            self._now = MetricEstimate(metres_per_unit=metres, sigma=sigma)
        return self._now

    def fit(self) -> MetricFit | None:
        """The scale over the whole run, smoothed from all readings; None without a reading."""
        return fit_readings(self.readings) if self.readings else None
