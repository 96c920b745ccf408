"""Quantities of the charts of a report, with their names."""

from __future__ import annotations

import math

import numpy as np

from farpoint.sinks.report.charts import Chart, Curve
from farpoint.sinks.report.digest import Digest
from farpoint.sinks.report.lengths import LengthUnit

__all__ = ["charts_of"]


def charts_of(digest: Digest, unit: LengthUnit) -> list[Chart]:
    """Charts of rotation and direction (with 1-sigma bands), sigmas, noise and matches."""
    if not digest.series:
        return []
    series = digest.series

    def curve(name: str, key: str, style: str) -> Curve:
        return Curve(name=name, style=style, values=series[key])

    def with_band(name: str, key: str, style: str, period: float = math.inf) -> Curve:
        sigma = series[f"{key}_sigma"].first
        return Curve(name=name, style=style, values=series[key], sigma=sigma, period=period)

    rotations = [
        Chart(
            title=f"Rotation about {axis} ({measurement})",
            unit="deg per pair",
            curves=[with_band(axis, f"rotation_{axis}", f"c{number}")],
        )
        for number, (axis, measurement) in enumerate(
            (("x", "pitch"), ("y", "yaw"), ("z", "roll")), start=1
        )
    ]
    lengths = []
    if np.isfinite(series["scale_sigma"].first).any():
        lengths.append(
            Chart(
                title="Length of the step",
                unit=unit.name,
                curves=[with_band("length", "scale", "c2")],
            )
        )
    return [
        *rotations,
        Chart(
            title="Direction of travel, to the right",
            unit="deg from the optical axis",
            curves=[with_band("right", "right", "c1", period=360.0)],
        ),
        Chart(
            title="Direction of travel, upwards",
            unit="deg",
            curves=[with_band("up", "up", "c2")],
        ),
        Chart(
            title="1-sigma",
            unit="deg, along the longest axis",
            curves=[
                curve("rotation", "rotation_sigma", "c1"),
                curve("direction", "direction_sigma", "c2"),
            ],
            log=True,
        ),
        *lengths,
        Chart(title="Track noise", unit="px", curves=[curve("noise", "noise_px", "c3")]),
        Chart(
            title="Matches",
            unit="per pair",
            curves=[
                curve("far", "far", "far"),
                curve("near", "near", "near"),
                curve("outliers", "outliers", "grey"),
            ],
        ),
    ]
