"""The head of the page: length, speed, accuracy and faults of the run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from html import escape
from typing import Any

import numpy as np

from farpoint.pose import PoseStatus
from farpoint.sinks.report.digest import Digest
from farpoint.sinks.report.lengths import LengthUnit, length_unit
from farpoint.sinks.report.paths import Paths

__all__ = ["headline"]

_STATE = {
    "done": "the source was read to its end",
    "interrupted": "stopped by the user; everything up to there is valid",
    "failed": "stopped by an error; everything up to there is valid",
    "running": "still going on, or killed before it could end",
}


def headline(run: Mapping[str, Any], digest: Digest, paths: Paths) -> str:
    """Title, state and error, summaries of length, speed, accuracy and faults, facts, and notes."""
    pairs = sum(digest.counts.values())
    ok = digest.counts[PoseStatus.OK]
    part = f" ({100 * ok / pairs:.1f} %)" if pairs else ""
    state = run["state"]
    notes = "".join(f"<p>{escape(note)}</p>" for note in run["notes"])
    notes = f'<div class="notes">{notes}</div>' if notes else ""
    error = f'<p class="quiet">{escape(run["error"])}</p>' if run.get("error") else ""
    answers = "".join(
        f"<div><dt>{escape(question)}</dt><dd>{answer}</dd></div>"
        for question, answer in (
            ("How far", _how_far(digest, paths, length_unit(run))),
            ("How fast", _how_fast(digest)),
            ("How sure", _how_sure(digest)),
            ("What went wrong", _what_went_wrong(run, digest, paths)),
        )
    )
    facts = "".join(
        f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>"
        for name, value in _facts(run, digest)
        if value
    )
    return (
        f"<header><h1>{escape(run['source']['name'])}</h1>"
        f'<p class="lead"><b>{ok} of {pairs}</b> pairs of frames with rotation and direction'
        f"{part}</p>"
        f'<p><span class="state {escape(state)}">{escape(state)}</span> '
        f"<small>{escape(_STATE.get(state, ''))}</small></p>{error}"
        f'<dl class="answers">{answers}</dl><dl class="facts">{facts}</dl>{notes}</header>\n'
    )


def _how_far(digest: Digest, paths: Paths, unit: LengthUnit) -> str:
    lasted = f"{digest.span_s:.4g} s"
    if not len(paths.lengths) or not _has_scale(digest):
        return f"<b>{lasted}</b><small>lengths are not known</small>"
    sigma = _final_sigma(paths)
    end = "" if sigma is None else f"the end is known to {unit.after(f'{sigma:.2g}')}, 1-sigma"
    note = "; ".join(part for part in (unit.meaning, end) if part)
    return f"<b>{paths.lengths.sum():.4g}</b> {unit.plural}, {lasted}<small>{note}</small>"


def _final_sigma(paths: Paths) -> float | None:
    """1-sigma of the last position along its longest axis; None if unknown or after a break."""
    covariance = paths.covariance[-1]
    if paths.segments[-1] != paths.segments[0] or not np.isfinite(covariance).all():
        return None
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))


def _how_fast(digest: Digest) -> str:
    rate = digest.series.get("rate")
    if rate is None or not np.isfinite(rate.first).any():
        return "no motion is known"
    return (
        f"<b>{np.nanmedian(rate.first):.3g} deg/s</b> turning<small>at most "
        f"{np.nanmax(rate.high):.3g} deg/s</small>"
    )


def _how_sure(digest: Digest) -> str:
    def typical(key: str) -> str:
        series = digest.series.get(key)
        if series is None or not np.isfinite(series.first).any():
            return "not known"
        return f"{np.nanmedian(series.first):.2g} deg"

    return (
        f"<b>{typical('rotation_sigma')}</b> rotation, <b>{typical('direction_sigma')}</b> "
        f"direction<small>median 1-sigma of a pair</small>"
    )


def _what_went_wrong(run: Mapping[str, Any], digest: Digest, paths: Paths) -> str:
    wrong = [
        f"{digest.counts[status]} {status.value}"
        for status in (PoseStatus.FAILED, PoseStatus.ROTATION_ONLY, PoseStatus.STATIC)
        if digest.counts[status]
    ]
    if run.get("frames_without_image"):
        wrong.append(f"{run['frames_without_image']} frames without an image")
    if len(paths.segments) and (lost := int(paths.segments[-1] - paths.segments[0])):
        wrong.append(f"the scale lost {lost} times" if lost > 1 else "the scale lost once")
    if guesses := run.get("scale_guesses", 0):
        times = f"{guesses} times" if guesses > 1 else "once"
        wrong.append(f"the scale carried by the last speed alone {times}")
    if not wrong:
        return "<b>nothing</b><small>every pair has rotation and direction</small>"
    return f"<b>{escape(', '.join(wrong))}</b><small>see below</small>"


def _has_scale(digest: Digest) -> bool:
    sigma = digest.series.get("scale_sigma")
    return sigma is not None and bool(np.isfinite(sigma.first).any())


def _facts(run: Mapping[str, Any], digest: Digest) -> Iterator[tuple[str, str]]:
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
    noise = digest.series.get("noise_px")
    if noise is not None and np.isfinite(noise.first).any():
        yield "Track noise", f"{np.nanmedian(noise.first):.3g} px, median 1-sigma"
