"""What somebody knows of lengths: it puts a trajectory on the scale of metres."""

from farpoint.hints.kinds import CameraHeight, GnssPositions, Hint, KnownDistance, KnownSpeed
from farpoint.hints.metric_scale import MetricEstimate, MetricScale
from farpoint.hints.options import HeightOptions, MetricOptions
from farpoint.hints.readings import Reading
from farpoint.hints.smoothing import Contradiction, MetricFit, fit_readings
from farpoint.hints.tables import read_gnss, read_speeds

__all__ = [
    "CameraHeight",
    "Contradiction",
    "GnssPositions",
    "HeightOptions",
    "Hint",
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
