"""The scale in metres while a run goes on, and of all of it at the end."""

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

_RECENT = 120  # readings behind the estimate of now


@dataclass(frozen=True, kw_only=True)
class MetricEstimate:
    """What a unit of the trajectory is.

    Attributes
    ----------
    metres_per_unit : float
        Positive.
    sigma : float
        1-sigma of its logarithm.
    """

    metres_per_unit: float
    sigma: float


class MetricScale:
    """Compares the results of `Odometry` with hints.

    Parameters
    ----------
    hints : iterable of Hint
        `KnownSpeed`, `CameraHeight`, `KnownDistance` or `GnssPositions`; those of one kind share
        their errors.

    Attributes
    ----------
    readings : list of Reading
        All comparisons so far: one a second for each hint at most.

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
        """Take in the next result; the scale of now, None as long as no hint has spoken."""
        new = [reading for gatherer in self._gatherers for reading in gatherer.add(camera, result)]
        if new:
            self.readings += new
            self._recent.extend(new)
            fit = fit_readings(list(self._recent))
            metres, sigma = fit.at(result.timestamp, result.segment)
            self._now = MetricEstimate(metres_per_unit=metres, sigma=sigma)
        return self._now

    def fit(self) -> MetricFit | None:
        """The scale over the whole run, smoothed; None if no hint has spoken."""
        return fit_readings(self.readings) if self.readings else None
