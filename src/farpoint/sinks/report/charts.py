"""Charts as inline SVG whose curves scale with the page.

The SVG has curves only, in a rectangle of `_WIDTH` x `_HEIGHT` units that is stretched to the plot;
line widths are not stretched. Numbers are HTML around the SVG, so that the size of the text does
not depend on the size of the page.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from farpoint.pose import PoseStatus
from farpoint.sinks.report.digest import Digest, Series

__all__ = ["Chart", "Curve", "draw_chart", "nice_step", "status_strip"]

_WIDTH, _HEIGHT = 1000, 300  # size of the SVG before stretching, SVG units
_MINUTE_STEPS_S = (30, 60, 120, 300, 600, 900, 1800, 3600)


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """A curve of a chart.

    Attributes
    ----------
    name : str
        Name in the legend and in the values at the cursor.
    style : str
        CSS class that gives the colour.
    values : Series
        Values of the curve.
    sigma : ndarray, shape (B,), or None
        1-sigma of ``values.first``, drawn as a band; None for no band.
    period : float
        Period of the quantity, such as 360 deg for an angle; infinite if not periodic.
    """

    name: str
    style: str
    values: Series
    sigma: np.ndarray | None = None
    period: float = math.inf


@dataclass(frozen=True, kw_only=True, eq=False)
class Chart:
    """Curves over time that share an axis.

    Attributes
    ----------
    title, unit : str
        Words above the chart.
    curves : list of Curve
        Curves of the chart.
    log : bool
        Draw on a logarithmic axis.
    """

    title: str
    unit: str
    curves: list[Curve]
    log: bool = False


def draw_chart(chart: Chart, digest: Digest, number: int) -> str:
    """HTML figure of a chart. `number` identifies the chart in the JavaScript of the cursor."""
    low, high = _log_range(chart.curves) if chart.log else _range(chart.curves)
    height = _height_map(low, high, log=chart.log)
    span_s = max(digest.span_s, 1e-9)
    across = digest.time_s / span_s * _WIDTH
    ticks = _ticks(low, high, log=chart.log)
    shapes = [
        f'<line class="grid" x1="0" x2="{_WIDTH}" y1="{y:.1f}" y2="{y:.1f}"/>'
        for y in map(height, ticks)
    ]
    for curve in chart.curves:
        shapes += _shapes(curve, across, height, thinned=digest.stride > 1)
    labels = [
        f'<span class="y" style="top:{100 * height(tick) / _HEIGHT:.2f}%">{tick:g}</span>'
        for tick in ticks
    ]
    labels += [
        f'<span class="x" style="left:{100 * tick / span_s:.2f}%">{_clock(tick, span_s)}</span>'
        for tick in _time_ticks(span_s)
    ]
    legend = " ".join(
        f'<span class="key {curve.style}">{escape(curve.name)}</span>'
        for curve in chart.curves
        if len(chart.curves) > 1
    )
    title = escape(chart.title)
    return (
        f"<figure><figcaption><b>{title}</b> <small>{escape(chart.unit)}</small> {legend}"
        f'<output data-chart="{number}" aria-live="off"></output></figcaption>'
        f'<div class="plot" tabindex="0" role="group" aria-label="{title}: {_alt_text(chart)}">'
        f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" preserveAspectRatio="none" role="img" '
        f'aria-label="{title} over time">{"".join(shapes)}</svg>{"".join(labels)}'
        f'<i class="cursor"></i></div></figure>\n'
    )


def _alt_text(chart: Chart) -> str:
    """The range of each curve in words, for screen readers."""
    words = []
    for curve in chart.curves:
        known = np.isfinite(curve.values.first)
        if known.any():
            low, high = np.nanmin(curve.values.low), np.nanmax(curve.values.high)
            middle = np.nanmedian(curve.values.first)
            words.append(
                f"{curve.name} from {low:.3g} to {high:.3g}, median {middle:.3g} {chart.unit}"
            )
    return escape("; ".join(words) or "no value")


def _shapes(
    curve: Curve, across: np.ndarray, height: Callable[[ArrayLike], Any], *, thinned: bool
) -> list[str]:
    """Shapes of a curve, from back to front: envelope (if ``thinned``), 1-sigma band, and line."""
    first, shapes = curve.values.first, []
    wraps = np.abs(np.diff(first)) > curve.period / 2.0
    if thinned:
        none = np.zeros(len(first) - 1, bool)
        envelope = _band(across, height(curve.values.low), height(curve.values.high), none)
        shapes.append(f'<path class="envelope {curve.style}" d="{envelope}"/>')
    if curve.sigma is not None:
        band = _band(across, height(first - curve.sigma), height(first + curve.sigma), wraps)
        shapes.append(f'<path class="band {curve.style}" d="{band}"/>')
    line = _line(across, height(first), wraps)
    shapes.append(f'<path class="curve {curve.style}" d="{line}"/>')
    return shapes


def status_strip(digest: Digest) -> str:
    """A bar over the run's time, coloured by the worst status of each bin."""
    edges = np.append(digest.begin_s, digest.span_s) * _WIDTH / max(digest.span_s, 1e-9)
    rects, start = [], 0
    for index in range(1, len(digest.worst) + 1):
        if index < len(digest.worst) and digest.worst[index] is digest.worst[start]:
            continue
        x, right = edges[start], edges[index]
        name = digest.worst[start].value
        rects.append(
            f'<rect class="{name}" x="{x:.2f}" width="{right - x:.2f}" height="10">'
            f"<title>{name}</title></rect>"
        )
        start = index
    keys = " ".join(f'<span class="key {s.value}">{s.value}</span>' for s in PoseStatus)
    return (
        f"<figure><figcaption><b>Status</b> {keys}</figcaption>"
        f'<div class="plot strip" tabindex="0" role="group" aria-label="status">'
        f'<svg viewBox="0 0 {_WIDTH} 10" preserveAspectRatio="none" '
        f'role="img" aria-label="status over time">{"".join(rects)}</svg>'
        f'<i class="cursor"></i></div></figure>\n'
    )


def _range(curves: list[Curve]) -> tuple[float, float]:
    """Limits of an axis that contain all values and nearly all 1-sigma bands."""
    values = [np.zeros(0)]
    for curve in curves:
        series, sigma = curve.values, curve.sigma
        values += [series.low, series.high]
        if sigma is not None and np.isfinite(sigma).any():
            usual = float(np.nanpercentile(sigma, 95.0))
            values += [series.low - usual, series.high + usual]
    known = np.concatenate(values)
    known = known[np.isfinite(known)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    margin = 0.05 * (high - low) or 0.5 * abs(high) or 0.5
    return low - margin if low < 0.0 else max(0.0, low - margin), high + margin


def _log_range(curves: list[Curve]) -> tuple[float, float]:
    """Limits of an axis at whole decades that contain all positive values."""
    known = np.concatenate([curve.values.first for curve in curves] or [np.zeros(0)])
    known = known[np.isfinite(known) & (known > 0.0)]
    if not known.size:
        return 0.1, 1.0
    low, high = math.floor(math.log10(known.min())), math.ceil(math.log10(known.max()))
    return 10.0**low, 10.0 ** max(high, low + 1)


def _height_map(low: float, high: float, *, log: bool) -> Callable[[ArrayLike], Any]:
    """Function from values to vertical SVG coordinates: ``high`` to 0, ``low`` to `_HEIGHT`.

    Coordinates are limited to one `_HEIGHT` above and below the plot.
    """

    def height(value: ArrayLike) -> Any:
        with np.errstate(divide="ignore", invalid="ignore"):
            part = (
                np.log(np.divide(value, low)) / np.log(high / low)
                if log
                else (np.subtract(value, low) / (high - low))
            )
        return np.clip(_HEIGHT * (1.0 - part), -_HEIGHT, 2.0 * _HEIGHT)

    return height


def _ticks(low: float, high: float, *, log: bool = False) -> list[float]:
    if log:
        return [10.0**k for k in range(round(math.log10(low)), round(math.log10(high)) + 1)]
    step = nice_step((high - low) / 6.0)
    first, last = math.ceil(low / step), math.floor(high / step)
    return [round(k * step, 12) for k in range(first, last + 1)]


def _time_ticks(span_s: float) -> list[float]:
    """Positions of marks, s, on an axis of this length; whole minutes on a long axis."""
    step = next((s for s in _MINUTE_STEPS_S if span_s > 120.0 and span_s <= 7 * s), 0)
    step = step or nice_step(span_s / 7.0)
    return [round(k * step, 12) for k in range(math.floor(span_s / step) + 1)]


def nice_step(rough: float) -> float:
    """Smallest of 1, 2, 5 times a power of ten that is at least `rough`."""
    decade = 10.0 ** math.floor(math.log10(rough))
    return next(m * decade for m in (1.0, 2.0, 5.0, 10.0) if m * decade >= rough * (1 - 1e-9))


def _clock(seconds: float, span_s: float) -> str:
    if span_s < 120.0:
        return f"{seconds:g} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d}"


def _line(x: np.ndarray, y: np.ndarray, wraps: np.ndarray) -> str:
    """SVG path through the points, broken at gaps and where ``wraps`` (B - 1,) is True."""
    words, joined = [], False
    for index in range(len(x)):
        if not np.isfinite(y[index]):
            joined = False
        elif joined and not wraps[index - 1]:
            words.append(f"L{x[index]:.2f} {y[index]:.1f}")
        else:
            # A single point is a line of length 0, which is visible by its round ends.
            words.append(f"M{x[index]:.2f} {y[index]:.1f}h0")
            joined = True
    return "".join(words)


def _band(x: np.ndarray, low: np.ndarray, high: np.ndarray, wraps: np.ndarray) -> str:
    """Closed SVG paths between two curves, a path for each unbroken stretch of `_line`."""
    known = np.isfinite(low) & np.isfinite(high)
    breaks = np.flatnonzero(~(known[1:] & known[:-1]) | wraps) + 1
    words = []
    for stretch in np.split(np.arange(len(x)), breaks):
        if known[stretch].all():
            there = [f"{x[i]:.2f} {high[i]:.1f}" for i in stretch]
            back = [f"{x[i]:.2f} {low[i]:.1f}" for i in stretch[::-1]]
            words.append("M" + "L".join(there + back) + "Z")
    return "".join(words)
