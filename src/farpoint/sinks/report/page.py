"""The page of a report, joined from its sections."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from html import escape
from importlib import resources
from typing import Any

import numpy as np

from farpoint.metrics import SplitHalf
from farpoint.pose import PoseStatus
from farpoint.sinks.report.charts import Chart, draw_chart, status_strip
from farpoint.sinks.report.digest import Digest
from farpoint.sinks.report.headline import headline
from farpoint.sinks.report.histogram import halves_section
from farpoint.sinks.report.lengths import LengthUnit, length_unit
from farpoint.sinks.report.lens import lens_section
from farpoint.sinks.report.maps import path_map
from farpoint.sinks.report.measures import charts_of
from farpoint.sinks.report.moments import Moment
from farpoint.sinks.report.paths import Paths
from farpoint.sinks.report.pictures import data_uri, moments_section
from farpoint.sinks.report.stills import Still

__all__ = ["PageContents", "render_page"]

_MEANING = {
    PoseStatus.OK: "rotation and direction of travel, both with covariance",
    PoseStatus.ROTATION_ONLY: "the rotation holds; the direction is not observable",
    PoseStatus.STATIC: "no motion beyond the noise",
    PoseStatus.FAILED: "no rotation can be trusted",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class PageContents:
    """Contents of a page.

    Attributes
    ----------
    run : dict
        Contents of ``run.json``.
    digest : Digest
        Reduced contents of ``motions.csv``.
    halves : list of SplitHalf
        Contents of ``halves.csv``.
    paths : Paths
        The path of ``positions.csv`` from above, and the true path if given.
    moments : list of Moment
        The worst moments.
    stills : list of Still
        Pictures of ``overlay.mp4`` at the times of ``moments``.
    thumbs : list of Still
        Small pictures of ``overlay.mp4``, spread over the run.
    """

    run: dict[str, Any]
    digest: Digest
    halves: list[SplitHalf]
    paths: Paths
    moments: list[Moment]
    stills: list[Still]
    thumbs: list[Still]


def render_page(page: PageContents) -> str:
    """The whole HTML document."""
    name = escape(page.run["source"]["name"])
    unit = length_unit(page.run)
    charts = charts_of(page.digest, unit)
    sections = [
        headline(page.run, page.digest, page.paths),
        _status_table(page.digest),
        moments_section(page.moments, page.stills, page.thumbs),
        _charts_section(charts, page.digest),
        _path_section(page.paths, unit),
        lens_section(page.run),
        halves_section(page.halves),
        _reasons_section(page.run),
        _options_section(page.run),
    ]
    return (
        f'<!doctype html>\n<html lang="en"{_palette(page.run)}>\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{name} – farpoint</title>\n<style>\n{_asset('page.css')}</style>\n</head>\n"
        f"<body>\n<main>\n{''.join(sections)}</main>\n{_script(charts, page)}"
        f"</body>\n</html>\n"
    )


def _status_table(digest: Digest) -> str:
    pairs = max(1, sum(digest.counts.values()))
    rows = "".join(
        f'<tr><td><span class="key {status.value}">{status.value}</span></td>'
        f'<td class="n">{count}</td><td class="n">{100 * count / pairs:.1f} %</td>'
        f"<td>{_MEANING[status]}</td></tr>"
        for status, count in digest.counts.items()
    )
    return (
        f'<section><h2>Pairs by status</h2><div class="wide"><table><thead><tr><th>Status</th>'
        f'<th class="n">Pairs</th><th class="n">Part</th><th>What is known</th></tr></thead>'
        f"<tbody>{rows}</tbody></table></div></section>\n"
    )


def _charts_section(charts: list[Chart], digest: Digest) -> str:
    if not charts:
        return "<section><h2>Over time</h2><p>No pair of frames was finished.</p></section>\n"
    drawn = "".join(draw_chart(chart, digest, number) for number, chart in enumerate(charts))
    thinned = (
        f" Each point is the first of {digest.stride} pairs, the pale area spans all of them, and "
        f"the bar shows the worst status among them."
        if digest.stride > 1
        else ""
    )
    return (
        f'<section><h2>Over time</h2><p class="quiet hint">Point or touch to read values and see '
        f"the frame; drag sideways, or the keys + and -, to zoom; arrows move the cursor; Escape "
        f'or a double click shows all. <button type="button" id="all" hidden>Show all</button></p>'
        f'{status_strip(digest)}{drawn}<div id="peek" hidden aria-hidden="true"></div>'
        f'<p class="quiet">Bands are 1-sigma. Rotations are the rotation vector of cam1_from_cam0 '
        f"in camera axes (x right, y down, z forward).{thinned}</p></section>\n"
    )


def _palette(run: Mapping[str, Any]) -> str:
    """HTML attribute with the palette in which the video was drawn."""
    output = run["options"].get("output", {})
    name = output.get("palette") if isinstance(output, Mapping) else None
    return f' data-palette="{escape(str(name))}"' if name else ""


def _path_section(paths: Paths, unit: LengthUnit) -> str:
    if len(paths.x_z) < 2:
        return ""
    drawn = path_map(paths, unit)
    return f"<section><h2>Path from above</h2><figure>{drawn}</figure></section>\n"


def _reasons_section(run: Mapping[str, Any]) -> str:
    reasons = run["reasons"]
    if not reasons:
        return ""
    start_s = float(run.get("first_timestamp") or 0.0)
    rows = "".join(
        f'<tr><td class="n">{int(item["frame0"])}–{int(item["frame1"])}</td>'
        f'<td class="n">{float(item["timestamp1"]) - start_s:.2f} s</td>'
        f'<td><span class="key {escape(item["status"])}">{escape(item["status"])}</span></td>'
        f'<td class="word">{escape(item["reason"])}</td></tr>'
        for item in reasons
    )
    noun = "pair" if len(reasons) == 1 else "pairs"
    omitted = run.get("reasons_omitted", 0)
    more = f'<p class="quiet">{omitted} more are not listed here.</p>' if omitted else ""
    return (
        f"<section><h2>Pairs that are not OK</h2><details{' open' if len(reasons) <= 20 else ''}>"
        f'<summary>{len(reasons)} {noun} with the reason</summary><div class="wide"><table>'
        f'<thead><tr><th class="n">Frames</th><th class="n">Time</th><th>Status</th>'
        f"<th>Reason</th></tr></thead><tbody>{rows}</tbody></table></div>{more}</details>"
        f"</section>\n"
    )


def _options_section(run: Mapping[str, Any]) -> str:
    def table(values: Mapping[str, Any]) -> str:
        rows = "".join(
            f'<tr><td class="word">{escape(key)}</td>'
            f'<td class="word">{escape(str(value))}</td></tr>'
            for key, value in _flat(values)
        )
        return f'<div class="wide"><table><tbody>{rows}</tbody></table></div>'

    return (
        f"<section><h2>How it was run</h2>"
        f"<details><summary>Effective options</summary>{table(run['options'])}</details>"
        f"<details><summary>Camera</summary>{table(run['camera'])}</details>"
        f"<details><summary>Versions</summary>{table(run['versions'])}</details></section>\n"
    )


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Nested settings as dotted names."""
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _script(charts: list[Chart], page: PageContents) -> str:
    """JavaScript of the page: the values of the curves, and the code that moves the cursor."""
    if not charts:
        return ""
    digest, paths = page.digest, page.paths
    curves = {
        "span": digest.span_s,
        "time": [round(float(value), 3) for value in digest.time_s],
        "charts": [
            [
                {
                    "name": curve.name,
                    "values": _numbers(curve.values.first),
                    "sigma": None if curve.sigma is None else _numbers(curve.sigma),
                }
                for curve in chart.curves
            ]
            for chart in charts
        ],
        "thumbs": [[round(thumb.time_s, 3), data_uri(thumb)] for thumb in page.thumbs],
        "path": [_numbers(column) for column in (paths.time_s, *paths.x_z.T)],
    }
    data = json.dumps(curves, separators=(",", ":"), allow_nan=False)
    return (
        f'<script type="application/json" id="curves">{data}</script>\n'
        f"<script>\n{_asset('page.js')}</script>\n"
    )


def _numbers(values: np.ndarray) -> list[float | None]:
    return [float(f"{value:.4g}") if np.isfinite(value) else None for value in values]


def _asset(name: str) -> str:
    return resources.files("farpoint.sinks.report").joinpath(name).read_text(encoding="utf-8")
