"""The page's sections, from what the other files of the folder say."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from html import escape
from importlib import resources
from typing import Any

import numpy as np

from farpoint.pose import PoseStatus
from farpoint.sinks.report.charts import Chart, draw_chart, path_map, status_strip
from farpoint.sinks.report.digest import Digest
from farpoint.sinks.report.measures import charts_of
from farpoint.sinks.report.stills import Still

__all__ = ["PageContents", "render_page"]

_MEANING = {
    PoseStatus.OK: "rotation and direction of travel, both with covariance",
    PoseStatus.ROTATION_ONLY: "the rotation holds; the direction is not observable",
    PoseStatus.STATIC: "no motion beyond the noise",
    PoseStatus.FAILED: "no rotation can be trusted",
}
_STATE = {
    "done": "the source was read to its end",
    "interrupted": "stopped by the user; everything up to there is valid",
    "failed": "stopped by an error; everything up to there is valid",
    "running": "still going on, or killed before it could end",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class PageContents:
    """Everything a page is made of.

    Attributes
    ----------
    run : dict
        ``run.json``.
    digest : Digest
        ``motions.csv``.
    path_x_z : ndarray, shape (P, 2)
        ``trajectory.tum`` from above.
    stills : list of Still
        Pictures of ``overlay.mp4``.
    """

    run: dict[str, Any]
    digest: Digest
    path_x_z: np.ndarray
    stills: list[Still]


def render_page(page: PageContents) -> str:
    """The whole HTML document."""
    name = escape(page.run["source"]["name"])
    charts = charts_of(page.digest)
    sections = [
        _headline(page),
        _status_table(page.digest),
        _charts_section(charts, page.digest),
        _stills_section(page.stills),
        _path_section(page.path_x_z),
        _reasons_section(page.run),
        _options_section(page.run),
    ]
    return (
        f'<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{name} – farpoint</title>\n<style>\n{_asset('page.css')}</style>\n</head>\n"
        f"<body>\n<main>\n{''.join(sections)}</main>\n{_script(charts, page.digest)}"
        f"</body>\n</html>\n"
    )


def _headline(page: PageContents) -> str:
    run, digest = page.run, page.digest
    pairs = sum(digest.counts.values())
    ok = digest.counts[PoseStatus.OK]
    part = f" ({100 * ok / pairs:.1f} %)" if pairs else ""
    state = run["state"]
    notes = "".join(f"<p>{escape(note)}</p>" for note in run["notes"])
    notes = f'<div class="notes">{notes}</div>' if notes else ""
    error = f'<p class="quiet">{escape(run["error"])}</p>' if run.get("error") else ""
    facts = "".join(
        f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in _facts(page) if value
    )
    return (
        f"<header><h1>{escape(run['source']['name'])}</h1>"
        f'<p class="lead"><b>{ok} of {pairs}</b> pairs of frames with rotation and direction'
        f"{part}</p>"
        f'<p><span class="state {escape(state)}">{escape(state)}</span> '
        f"<small>{escape(_STATE.get(state, ''))}</small></p>{error}"
        f"<dl>{facts}</dl>{notes}</header>\n"
    )


def _facts(page: PageContents) -> Iterator[tuple[str, str]]:
    run, digest = page.run, page.digest
    source, camera = run["source"], run["camera"]
    pairs = sum(digest.counts.values())
    yield "Source", source["given"]
    size = "x".join(map(str, camera["size"])) if camera.get("size") else "size unknown"
    focal = ", ".join(
        f"{key} {camera['parameters'][key]:.6g}"
        for key in ("fx", "fy")
        if isinstance(camera.get("parameters", {}).get(key), int | float)
    )
    yield "Camera", ", ".join(part for part in (camera["model"], size, focal) if part)
    if pairs:
        yield "Duration", f"{digest.span_s:.2f} s, {pairs + 1} frames"
    yield "Time stamps", source.get("timestamps") or ""
    typical = [
        f"{name} {np.nanmedian(digest.series[key].first):.3g} {unit}"
        for name, key, unit in (
            ("rotation", "rotation_sigma", "deg"),
            ("direction", "direction_sigma", "deg"),
            ("tracks", "noise_px", "px"),
        )
        if key in digest.series and np.isfinite(digest.series[key].first).any()
    ]
    yield "Typical 1-sigma", ", ".join(typical)


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
        f"<section><h2>Over time</h2>{status_strip(digest)}{drawn}"
        f'<p class="quiet">Bands are 1-sigma. Rotations are the rotation vector of cam1_from_cam0 '
        f"in camera axes (x right, y down, z forward).{thinned}</p></section>\n"
    )


def _stills_section(stills: list[Still]) -> str:
    if not stills:
        return ""
    figures = "".join(
        f'<figure><img alt="working display at {still.time_s:.2f} s" loading="lazy" '
        f'src="data:image/jpeg;base64,{base64.b64encode(still.jpeg).decode()}">'
        f"<figcaption>{still.time_s:.2f} s</figcaption></figure>"
        for still in stills
    )
    return (
        f'<section><h2>Working display</h2><p class="quiet">From overlay.mp4: far points red, '
        f"near points green, outliers grey; the flow that translation leaves, with the epipole "
        f'and its 95 % ellipse.</p><div class="stills">{figures}</div></section>\n'
    )


def _path_section(x_z: np.ndarray) -> str:
    if len(x_z) < 2:
        return ""
    return f"<section><h2>Path from above</h2><figure>{path_map(x_z)}</figure></section>\n"


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


def _script(charts: list[Chart], digest: Digest) -> str:
    """The curves as data for the cursor, and the code that moves it."""
    if not charts:
        return ""
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
