"""The worst moments with pictures, and an overview of the whole run."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape

from farpoint.sinks.report.moments import Moment
from farpoint.sinks.report.stills import Still

__all__ = ["data_uri", "moments_section"]

_MAX_FIGURES = 6
_SAME_S = 1e-3


def data_uri(still: Still) -> str:
    """A picture encoded as text, so that the page needs no other file."""
    return f"data:image/jpeg;base64,{base64.b64encode(still.jpeg).decode()}"


def moments_section(
    moments: Sequence[Moment], stills: Sequence[Still], thumbs: Sequence[Still]
) -> str:
    """The worst moments, and below them pictures of the whole run."""
    if not moments and not thumbs:
        return ""
    by_time = {round(still.time_s / _SAME_S): still for still in stills}
    figures = "".join(
        _figure(moment, by_time.get(round(moment.time_s / _SAME_S))) for moment in moments
    )
    chosen = min(_MAX_FIGURES, len(thumbs))
    strip = "".join(
        f'<figure><img alt="working display at {thumb.time_s:.2f} s" src="{data_uri(thumb)}">'
        f"<figcaption>{thumb.time_s:.2f} s</figcaption></figure>"
        for thumb in (thumbs[(2 * k + 1) * len(thumbs) // (2 * chosen)] for k in range(chosen))
    )
    strip = f'<h3>At a glance</h3><div class="strip-of">{strip}</div>' if strip else ""
    return (
        f'<section><h2>Worst moments</h2><p class="quiet">Stretches that are not OK, then the '
        f"extremes of the rest. Pictures are those of overlay.mp4: far points, near points and "
        f"outliers; the flow that translation leaves, with the epipole and its 95 % ellipse.</p>"
        f'<div class="stills">{figures}</div>{strip}</section>\n'
    )


def _figure(moment: Moment, still: Still | None) -> str:
    picture = (
        f'<img alt="working display at {moment.time_s:.2f} s" loading="lazy" '
        f'src="{data_uri(still)}">'
        if still
        else ""
    )
    return (
        f"<figure>{picture}<figcaption><b>{escape(moment.title)}</b> <small>at "
        f"{moment.time_s:.2f} s, frames {moment.frame0}–{moment.frame1}</small><br>"
        f"{escape(moment.reason)}</figcaption></figure>"
    )
