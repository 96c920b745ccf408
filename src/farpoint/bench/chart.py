"""Line chart with a logarithmic axis, as one self-contained SVG."""

from __future__ import annotations

import math
from collections.abc import Mapping
from html import escape

import numpy as np

__all__ = ["line_chart"]

_WIDTH, _HEIGHT = 760, 440
_LEFT, _RIGHT, _TOP, _BOTTOM = 60, 220, 40, 50
# Okabe and Ito's colours: distinct with any colour vision.
_COLOURS = (
    "#d55e00",
    "#0072b2",
    "#56b4e9",
    "#009e73",
    "#7fc8a9",
    "#000000",
    "#cc79a7",
    "#e69f00",
)
_STYLE = (
    "text{font:12px system-ui,sans-serif;fill:#333}.title{font-weight:600;font-size:14px}"
    ".grid{stroke:#ddd}.axis{stroke:#333}.line{fill:none;stroke-width:1.8;stroke-linejoin:round}"
)


def line_chart(
    title: str,
    x_label: str,
    y_label: str,
    x: np.ndarray,
    lines: Mapping[str, np.ndarray],
    *,
    log_x: bool,
) -> str:
    """Draw positive values over common abscissae; the first line is drawn thicker and on top.

    Parameters
    ----------
    title, x_label, y_label : str
    x : ndarray, shape (N,)
        Abscissae; positive if `log_x`.
    lines : mapping of str to ndarray, shape (N,)
        Values by name, in the order of the legend.
    log_x : bool
        Whether the horizontal axis is logarithmic. The vertical axis is always logarithmic.
    """
    every = np.concatenate(list(lines.values()))
    low, high = math.floor(math.log10(every.min())), math.ceil(math.log10(every.max()))
    high = max(high, low + 1)
    # A share is the position of a value along an axis, from 0 to 1.
    along = np.log10(x) if log_x else x
    across_share = (along - along[0]) / (along[-1] - along[0])
    across = _LEFT + across_share * (_WIDTH - _LEFT - _RIGHT)

    def height(values: np.ndarray | float) -> np.ndarray:
        share = (np.log10(values) - low) / (high - low)
        return _HEIGHT - _BOTTOM - share * (_HEIGHT - _TOP - _BOTTOM)

    shapes = [_frame(title, x_label, y_label)]
    shapes += [_tick_y(10.0**power, float(height(10.0**power))) for power in range(low, high + 1)]
    shapes += [_tick_x(value, place) for value, place in zip(x, across, strict=True)]
    drawn = [
        _line(name, across, height(values), number)
        for number, (name, values) in enumerate(lines.items())
    ]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" '
        f'width="{_WIDTH}" height="{_HEIGHT}"><style>{_STYLE}</style>'
        f'<rect width="{_WIDTH}" height="{_HEIGHT}" fill="#fff"/>'
        + "".join(shapes + drawn[::-1])
        + "</svg>\n"
    )


def _frame(title: str, x_label: str, y_label: str) -> str:
    bottom, right = _HEIGHT - _BOTTOM, _WIDTH - _RIGHT
    return (
        f'<text class="title" x="{_LEFT}" y="22">{escape(title)}</text>'
        f'<text x="{(_LEFT + right) / 2:g}" y="{_HEIGHT - 12}" text-anchor="middle">'
        f"{escape(x_label)}</text>"
        f'<text x="{_LEFT - 8}" y="{_TOP - 8}" text-anchor="end">{escape(y_label)}</text>'
        f'<path class="axis" fill="none" d="M{_LEFT} {_TOP}V{bottom}H{right}"/>'
    )


def _tick_y(value: float, y: float) -> str:
    return (
        f'<line class="grid" x1="{_LEFT}" x2="{_WIDTH - _RIGHT}" y1="{y:.1f}" y2="{y:.1f}"/>'
        f'<text x="{_LEFT - 8}" y="{y + 4:.1f}" text-anchor="end">{value:g}</text>'
    )


def _tick_x(value: float, x: float) -> str:
    bottom = _HEIGHT - _BOTTOM
    return (
        f'<line class="axis" x1="{x:.1f}" x2="{x:.1f}" y1="{bottom}" y2="{bottom + 5}"/>'
        f'<text x="{x:.1f}" y="{bottom + 19}" text-anchor="middle">{value:g}</text>'
    )


def _line(name: str, across: np.ndarray, heights: np.ndarray, number: int) -> str:
    colour = _COLOURS[number % len(_COLOURS)]
    width = ' style="stroke-width:3.2"' if number == 0 else ""
    points = "L".join(f"{x:.1f} {y:.1f}" for x, y in zip(across, heights, strict=True))
    legend_x, legend_y = _WIDTH - _RIGHT + 16, _TOP + 12 + 20 * number
    return (
        f'<path class="line" stroke="{colour}"{width} d="M{points}"/>'
        f'<path class="line" stroke="{colour}"{width} d="M{legend_x} {legend_y - 4}h20"/>'
        f'<text x="{legend_x + 26}" y="{legend_y}">{escape(name)}</text>'
    )
