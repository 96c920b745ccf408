"""Results of a run as hints see them: a path in a unit that drifts, without any image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint import Camera, OdometryResult
from farpoint.aiding import AidingMeasurement, MetricEstimate, MetricScale
from farpoint.tracks import Tracks

CAMERA = Camera.pinhole(640, 480, 500.0, 500.0, 319.5, 239.5)
UNIT_M = 1.3
"""Metres in a unit at the beginning."""


@dataclass
class Drive:
    """A path in metres, and what an odometry makes of it."""

    metres: np.ndarray
    log_unit: np.ndarray
    segment: np.ndarray
    drift_sigma: float = 0.04

    @property
    def times_s(self) -> np.ndarray:
        return 5.0 + 0.1 * np.arange(len(self.metres))

    @property
    def speeds(self) -> np.ndarray:
        """m/s of each step, at its middle."""
        return np.linalg.norm(np.diff(self.metres, axis=0), axis=1) / 0.1

    @property
    def middles_s(self) -> np.ndarray:
        return self.times_s[1:] - 0.05

    def results(self) -> list[OdometryResult]:
        steps = np.diff(self.metres, axis=0) / np.exp(self.log_unit[1:, None])
        places = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
        count, found = len(places), []
        for k, place in enumerate(places):
            pose, covariance = np.eye(4), np.zeros((7, 7))
            pose[:3, 3] = place
            covariance[6, 6] = self.drift_sigma**2 * k / count
            length = float(np.linalg.norm(steps[k - 1])) if k else None
            found.append(
                OdometryResult(
                    frame0=max(k - 1, 0),
                    frame1=k,
                    timestamp0=float(self.times_s[max(k - 1, 0)]),
                    timestamp=float(self.times_s[k]),
                    pose=None,
                    tracks=Tracks.empty(),
                    world_from_cam=pose,
                    world_covariance=covariance,
                    segment=int(self.segment[k]),
                    scale=length,
                    scale_sigma=None if length is None else 0.003 * length,
                )
            )
        return found


def winding(count: int = 400, drift: float = 0.04, break_at: int | None = None) -> Drive:
    """A drive of 40 s at 5 to 15 m/s in a curve; its unit grows by ``drift`` on the way."""
    k = np.arange(count)
    speed = 10.0 + 5.0 * np.sin(0.03 * k)
    heading = 0.004 * k
    steps = 0.1 * speed[:, None] * np.column_stack([np.sin(heading), 0.0 * k, np.cos(heading)])
    segment = np.zeros(count, int)
    log_unit = np.log(UNIT_M) - drift * k / count
    if break_at is not None:
        segment[break_at:] = 1
        log_unit[break_at:] += 0.4
    return Drive(metres=np.cumsum(steps, axis=0), log_unit=log_unit, segment=segment)


def tell(
    drive: Drive, *measurements: AidingMeasurement
) -> tuple[MetricScale, MetricEstimate | None]:
    """A scale that has seen the whole drive, and its last word on the way."""
    scale, now = MetricScale(measurements), None
    for result in drive.results():
        now = scale.add(CAMERA, result)
    return scale, now


def errors_of(drive: Drive, scale: MetricScale) -> np.ndarray:
    """Relative errors (N - 1,) of the steps in metres."""
    fit = scale.fit()
    assert fit is not None
    found = [fit.at(t, s)[0] for t, s in zip(drive.times_s, drive.segment, strict=True)]
    return np.array(found)[1:] / np.exp(drive.log_unit[1:]) - 1.0
