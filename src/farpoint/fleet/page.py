"""``fleet.html``: one page of all drives, unusual drives first, sortable offline."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import quote

from farpoint.fleet.folder import DRIVES
from farpoint.fleet.table import Row
from farpoint.sinks.files import replacing

__all__ = ["outliers_first", "write_page"]

_HEADINGS = {
    "drive": "Drive",
    "state": "State",
    "frames": "Frames",
    "duration_s": "Duration, s",
    "elapsed_s": "Computed in, s",
    "length": "Length",
    "unit": "Unit",
    "ok": "OK",
    "rotation_only": "Rotation only",
    "static": "Static",
    "failed": "Failed",
    "halves": "Halves (1: honest)",
    "noise_px": "Noise, px",
    "lens": "Lens found",
    "lens_sigma": "Its 1-sigma",
    "scale": "Scale",
    "scale_sigma": "Its 1-sigma",
    "worst": "Worst moments",
    "error": "Error",
    "source": "Source",
    "camera": "Camera",
}

_STYLE = """
body { font: 14px/1.4 system-ui, sans-serif; margin: 1.5em; color: #222; background: #fff }
table { border-collapse: collapse; font-variant-numeric: tabular-nums }
th { position: sticky; top: 0; background: #eee; cursor: pointer; text-align: left }
th, td { padding: .3em .6em; border-bottom: 1px solid #ddd; vertical-align: top }
td.n { text-align: right }
tr.failed td { background: #fde8e6 } tr.doubtful td { background: #fff6d9 }
tr.waiting td { color: #888 }
"""

_SCRIPT = """
const body = document.querySelector("tbody");
document.querySelectorAll("th").forEach((head, column) => head.addEventListener("click", () => {
  const down = head.dataset.down = head.dataset.down === "1" ? "" : "1";
  const value = row => row.cells[column].dataset.v ?? row.cells[column].textContent;
  const order = (a, b) => {
    const [x, y] = [value(a), value(b)];
    if (x === "" || y === "") return (x === "") - (y === "");
    const d = isNaN(x) || isNaN(y) ? x.localeCompare(y) : x - y;
    return down ? -d : d;
  };
  body.append(...[...body.rows].sort(order));
}));
"""


def outliers_first(rows: Sequence[Row]) -> list[Row]:
    """Failed drives, then finished drives with the most unusual first, then waiting drives."""
    return sorted(rows, key=lambda row: (row.state != "failed", row.state == "waiting", -_odd(row)))


def write_page(out: Path, rows: Sequence[Row]) -> None:
    """Write ``fleet.html`` into the folder of the fleet."""
    heads = "".join(f"<th>{heading}</th>" for heading in _HEADINGS.values())
    lines = "\n".join(_line(out, row) for row in outliers_first(rows))
    count = {state: sum(row.state == state for row in rows) for state in ("done", "failed")}
    left = len(rows) - sum(count.values())
    title = f"{len(rows)} drives: {count['done']} done, {count['failed']} failed"
    title += f", {left} waiting" if left else ""
    with replacing(out / "fleet.html") as part:
        part.write_text(
            f'<!doctype html>\n<html lang="en"><meta charset="utf-8"><title>{title}</title>\n'
            f"<style>{_STYLE}</style>\n<h1>{title}</h1>\n"
            "<p>Outliers first; click a heading to sort. Yellow: the split-half ratio is above "
            "what chance explains, or more than half of the pairs failed.</p>\n"
            f"<table><thead><tr>{heads}</tr></thead><tbody>\n{lines}\n</tbody></table>\n"
            f"<script>{_SCRIPT}</script>\n</html>\n",
            encoding="utf-8",
            newline="\n",
        )


def _is_suspicious(row: Row) -> bool:
    return (row.halves_high is not None and (row.halves or 0.0) > row.halves_high) or (
        _failed_share(row) > 0.5
    )


def _odd(row: Row) -> float:
    """Measure of how unusual a drive is, from split-half ratio and share of failed pairs."""
    over = 0.0 if not row.halves or not row.halves_high else row.halves / row.halves_high
    return over + 2.0 * _failed_share(row)


def _failed_share(row: Row) -> float:
    pairs = sum(count or 0 for count in (row.ok, row.rotation_only, row.static, row.failed))
    return (row.failed or 0) / pairs if pairs else 0.0


def _line(out: Path, row: Row) -> str:
    kind = "doubtful" if row.state == "done" and _is_suspicious(row) else row.state
    cells = "".join(_cell(out, row, name) for name in _HEADINGS)
    return f'<tr class="{kind}">{cells}</tr>'


def _cell(out: Path, row: Row, name: str) -> str:
    value = getattr(row, name)
    if name == "drive":
        report = f"{DRIVES}/{row.drive}/report.html"
        text = html.escape(row.drive)
        if row.state == "done" and (out / report).is_file():
            text = f'<a href="{quote(report)}">{text}</a>'
        return f"<td>{text}</td>"
    if value is None:
        return '<td class="n"></td>'
    if isinstance(value, str):
        return f"<td>{html.escape(value)}</td>"
    return f'<td class="n" data-v="{value!r}">{value:.6g}</td>'
