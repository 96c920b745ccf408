"""Sink that converts the files of a run to metres at the end, by aiding measurements."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from farpoint.aiding import AidingMeasurement, MetricEstimate, MetricFit, MetricScale
from farpoint.camera import Camera
from farpoint.odometry import OdometryResult
from farpoint.sinks.metric_files import put_in_metres

__all__ = ["MetricSink"]

NO_READING = (
    "no aiding measurement gave a reading of the scale: lengths are in the unit of the trajectory"
)


class MetricSink:
    """Sink that compares results with aiding measurements, to convert the text files to metres.

    Parameters
    ----------
    measurements : list of AidingMeasurement
        Aiding measurements of length.
    camera : Camera
        Camera of the frames.
    warn : callable
        Called with the text of each warning, such as contradictory aiding measurements.
    put : callable
        Called with a key and a value for ``run.json``.

    Attributes
    ----------
    now : MetricEstimate or None
        Metres per unit at the last result.
    """

    def __init__(
        self,
        measurements: list[AidingMeasurement],
        camera: Camera,
        warn: Callable[[str], object],
        put: Callable[[str, object], object],
    ) -> None:
        self._scale = MetricScale(measurements)
        self._camera = camera
        self._warn, self._put = warn, put
        self.now: MetricEstimate | None = None

    def write(self, result: OdometryResult, image: np.ndarray | None) -> None:
        """Add one result; the image is not used."""
        del image
        self.now = self._scale.add(self._camera, result)

    def close(self) -> None:
        """Do nothing: no file is open."""

    def finish(self, folder: Path) -> None:
        """Convert the files of ``folder``, which must be complete, to metres."""
        fit = self._scale.fit()
        if fit is None:
            self._warn(NO_READING)
            self._put("metric", {"unit": "that of the trajectory", "note": NO_READING})
            return
        put_in_metres(folder, fit)
        for contradiction in fit.contradictions:
            self._warn(str(contradiction))
        self._put("metric", _facts(fit))


def _facts(fit: MetricFit) -> dict[str, object]:
    metres = np.exp(fit.log_metres)
    return {
        "unit": "m",
        "readings": len(metres),
        "metres_per_unit": {"first": float(metres[0]), "last": float(metres[-1])},
        "relative_sigma": float(np.median(fit.sigma)),
        "contradictions": [str(contradiction) for contradiction in fit.contradictions],
    }
