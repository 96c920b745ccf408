"""HTML table of a pose for notebooks, without external scripts or styles."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from typing import TYPE_CHECKING

from farpoint.geometry.angles import heading_angles_deg, rotation_vector_deg

if TYPE_CHECKING:
    from farpoint.pose.result import RelativePose

__all__ = ["Row", "html_table", "pose_rows"]

Row = tuple[str, str]
"""Name and value; both are escaped."""

_SIGN = "\N{PLUS-MINUS SIGN}"


def html_table(title: str, rows: Iterable[Row]) -> str:
    """A table of HTML with a title above its rows."""
    style = "text-align:left;font-variant-numeric:tabular-nums"
    lines = "".join(
        f'<tr><th scope="row" style="text-align:left;white-space:nowrap">{escape(name)}</th>'
        f'<td style="{style}">{escape(value)}</td></tr>'
        for name, value in rows
    )
    caption = f'<caption style="text-align:left;font-weight:bold">{escape(title)}</caption>'
    return f"<table>{caption}<tbody>{lines}</tbody></table>"


def pose_rows(pose: RelativePose) -> list[Row]:
    """Table rows: the reason, each observed quantity with a 1-sigma, the number of matches."""
    rows = [("reason", pose.reason)]
    if pose.rotation_cam1_from_cam0 is not None and pose.rotation_covariance is not None:
        vector, sigma = rotation_vector_deg(pose.rotation_cam1_from_cam0, pose.rotation_covariance)
        rows.append(("rotation x, y, z", _with_sigma(vector, sigma, 4)))
    if pose.heading_cam0 is not None and pose.heading_covariance is not None:
        angles, sigma = heading_angles_deg(pose.heading_cam0, pose.heading_covariance)
        rows.append(("heading right, up", _with_sigma(angles, sigma, 3)))
    stats = pose.stats
    counts = f"{stats.far} far, {stats.near} near, {stats.outliers} outliers"
    rows.append(("matches", f"{stats.matches}: {counts}"))
    if pose.noise_px is not None:
        rows.append(("noise of a match", f"{pose.noise_px:.3f} px"))
    return rows


def _with_sigma(values: Iterable[float], sigma: Iterable[float], decimals: int) -> str:
    pairs = zip(values, sigma, strict=True)
    text = ", ".join(f"{v:+.{decimals}f} {_SIGN} {s:.{decimals}f}" for v, s in pairs)
    return f"{text} deg (1 sigma)"
