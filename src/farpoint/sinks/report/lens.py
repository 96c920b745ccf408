"""Lens and shutter in the report: given and estimated values with their sigmas."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

__all__ = ["lens_section"]


def lens_section(run: Mapping[str, Any]) -> str:
    """A table of the lens's parameters; empty if no parameter was estimated."""
    lens = run.get("lens")
    if not isinstance(lens, Mapping) or not lens.get("refined"):
        return ""
    rows = "".join(
        f'<tr><td class="word">{escape(name)}</td><td class="n">{float(given):.6g}</td>'
        f'<td class="n">{float(lens["found"][name]):.6g}</td>'
        f'<td class="n">{float(lens["sigma"][name]):.2g}</td></tr>'
        for name, given in lens["given"].items()
    )
    readout_ms, sigma_ms = 1e3 * float(lens["readout_s"]), 1e3 * float(lens["readout_sigma_s"])
    rows += (
        f'<tr><td class="word">read-out, ms</td><td class="n"></td>'
        f'<td class="n">{readout_ms:.3g}</td><td class="n">{sigma_ms:.2g}</td></tr>'
    )
    return (
        '<section><h2>Lens and shutter</h2><div class="wide"><table><thead><tr><th>Parameter</th>'
        '<th class="n">Given</th><th class="n">Found</th><th class="n">1-sigma</th></tr></thead>'
        f'<tbody>{rows}</tbody></table></div><p class="quiet">Between the lens given and the one '
        f"found pixels move by {float(lens['moved_px']):.2g} px at most.</p></section>\n"
    )
