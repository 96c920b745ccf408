"""Aiding measurements of length, which give a trajectory its metric scale."""

from farpoint.aiding.kinds import (
    AidingMeasurement,
    CameraHeight,
    GnssPositions,
    KnownDistance,
    KnownSpeed,
)
from farpoint.aiding.metric_scale import MetricEstimate, MetricScale
from farpoint.aiding.options import HeightOptions, MetricOptions
from farpoint.aiding.readings import Reading
from farpoint.aiding.smoothing import Contradiction, MetricFit, fit_readings
from farpoint.aiding.tables import read_gnss, read_speeds

__all__ = [
    "AidingMeasurement",
    "CameraHeight",
    "Contradiction",
    "GnssPositions",
    "HeightOptions",
    "KnownDistance",
    "KnownSpeed",
    "MetricEstimate",
    "MetricFit",
    "MetricOptions",
    "MetricScale",
    "Reading",
    "fit_readings",
    "read_gnss",
    "read_speeds",
]
