"""The path from above."""

from __future__ import annotations

import math

import numpy as np

from farpoint.sinks.report.charts import nice_step
from farpoint.sinks.report.lengths import LengthUnit
from farpoint.sinks.report.paths import Paths

__all__ = ["path_map"]

_ELLIPSES = 8
_CHI2_95 = 5.991  # of two degrees of freedom


def path_map(paths: Paths, unit: LengthUnit) -> str:
    """The path from above, with x to the right, z upwards, and a grid of round lengths."""
    points = paths.x_z if paths.true_x_z is None else np.vstack([paths.x_z, paths.true_x_z])
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    extent = max(float((high - low).max()), 1e-6)
    step = nice_step(extent / 6.0)
    left, bottom = np.floor(low / step - 0.5) * step
    right, top = np.ceil(high / step + 0.5) * step
    aside = step * np.ceil(max(0.0, 1.5 * (top - bottom) - (right - left)) / (2.0 * step))
    left, right = left - aside, right + aside  # the map is at least 1.5 times as wide as high
    digits = max(0, 3 - math.floor(math.log10(extent)))
    breaks = np.flatnonzero(np.diff(paths.segments)) + 1
    lines = [_line(part, "c1", digits) for part in np.split(paths.x_z, breaks)]
    ellipses = _ellipses(paths, digits)
    keys = '<span class="key start">start</span> <span class="key end">end</span>'
    if paths.true_x_z is not None:
        known = paths.true_x_z[np.isfinite(paths.true_x_z[:, 0])]
        lines.insert(0, _line(known, "truth", digits))
        keys += ' <span class="key c1">farpoint</span> <span class="key truth">truth</span>'
    if ellipses:
        keys += ' <span class="key c1">95 % ellipses</span>'
    if len(breaks):
        keys += ' <span class="key ROTATION_ONLY">the scale was lost</span>'
    dots = "".join(_dot("ROTATION_ONLY", paths.x_z[index], digits) for index in breaks)
    dots += _dot("start", paths.x_z[0], digits) + _dot("end", paths.x_z[-1], digits)
    return (
        f'<svg class="map" viewBox="{left:g} {-top:g} {right - left:g} {top - bottom:g}" '
        f'role="img" aria-label="path from above, {_alt_text(paths.x_z, unit)}">'
        f"{_grid(left, right, bottom, top, step)}{ellipses}{''.join(lines)}{dots}"
        f'<path class="dot here" d="" /></svg><p>A square of the grid is '
        f"{unit.after(f'{step:g}')} wide. {keys}; the first camera looks up the page.</p>"
    )


def _grid(left: float, right: float, bottom: float, top: float, step: float) -> str:
    return "".join(
        f'<line class="grid" x1="{x:g}" x2="{x:g}" y1="{-bottom:g}" y2="{-top:g}"/>'
        for x in np.arange(left, right + step / 2.0, step)
    ) + "".join(
        f'<line class="grid" x1="{left:g}" x2="{right:g}" y1="{-z:g}" y2="{-z:g}"/>'
        for z in np.arange(bottom, top + step / 2.0, step)
    )


def _line(x_z: np.ndarray, style: str, digits: int) -> str:
    points = " ".join(f"{x:.{digits}f},{-z:.{digits}f}" for x, z in x_z)
    return f'<polyline class="curve {style}" points="{points}"/>'


def _ellipses(paths: Paths, digits: int) -> str:
    """95 % ellipses of a few positions, evenly spread over the length of the path."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(paths.x_z, axis=0), axis=1))])
    wanted = np.linspace(0.0, way[-1], _ELLIPSES + 1)[1:]
    chosen = np.unique(np.minimum(np.searchsorted(way, wanted), len(way) - 1))
    circle = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)
    shapes = []
    for index in chosen:
        covariance = paths.covariance[index]
        if np.isfinite(covariance).all():
            squares, axes = np.linalg.eigh(covariance)
            radii = np.sqrt(_CHI2_95 * np.maximum(squares, 0.0))
            ring = (
                paths.x_z[index] + (np.stack([np.cos(circle), np.sin(circle)], 1) * radii) @ axes.T
            )
            points = " ".join(f"{x:.{digits}f},{-z:.{digits}f}" for x, z in ring)
            shapes.append(f'<polygon class="band c1" points="{points}"/>')
    return "".join(shapes)


def _dot(style: str, place: np.ndarray, digits: int) -> str:
    # A line of no length with round ends: a dot whose size does not stretch.
    return f'<path class="dot {style}" d="M{place[0]:.{digits}f} {-place[1]:.{digits}f}h0"/>'


def _alt_text(x_z: np.ndarray, unit: LengthUnit) -> str:
    width, depth = np.ptp(x_z, axis=0)
    return f"{unit.after(f'{width:.3g}')} wide and {unit.after(f'{depth:.3g}')} deep"
