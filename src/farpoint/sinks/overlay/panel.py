"""The panel below the panes: status, matches, and rotation and heading with 1-sigma."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from farpoint.geometry.angles import heading_angles_deg, rotation_vector_deg
from farpoint.odometry import OdometryResult
from farpoint.pose import PoseStatus, RelativePose
from farpoint.sinks.overlay.canvas import draw_text, text_width
from farpoint.sinks.overlay.palette import QUIET_GREY, WHITE, Colour, Palette

__all__ = ["draw_panel"]

Row = tuple[str, str, str]
"""Name, value and its 1-sigma."""


def draw_panel(
    pixels: np.ndarray, result: OdometryResult, line_px: float, palette: Palette
) -> None:
    """Fill the panel (H, W, 3) with the values of one pair."""
    pose = result.pose
    if pose is None:
        _write(pixels, "first frame: nothing to compare it with", 0.5, 1.0, line_px, QUIET_GREY)
        return
    _draw_verdict(pixels, result, pose, line_px, palette)
    third = pixels.shape[1] / line_px / 3.0
    _draw_table(pixels, "rotation vector, deg (1 sigma)", _rotation_rows(pose), 0.5, line_px)
    _draw_table(pixels, "heading, deg (1 sigma)", _heading_rows(result, pose), 0.5 + third, line_px)
    _draw_matches(pixels, pose, 0.5 + 2.0 * third, line_px, palette)


def _draw_verdict(
    pixels: np.ndarray,
    result: OdometryResult,
    pose: RelativePose,
    line_px: float,
    palette: Palette,
) -> None:
    """Draw the status as a coloured label and the frame numbers, and below the label the reason."""
    capital, word = 0.5 * line_px, pose.status.value
    width = text_width(word, capital, bold=True) + line_px
    top, left = 0.35 * line_px, 0.4 * line_px
    pixels[round(top) : round(top + 1.1 * line_px), round(left) : round(left + width)] = (
        _status_colour(pose.status, palette)
    )
    draw_text(pixels, word, left + 0.5 * line_px, 1.15 * line_px, capital, WHITE, bold=True)
    frames = f"{result.frame0} to {result.frame1}"
    _write(pixels, frames, (left + width) / line_px + 0.5, 1.15, line_px, QUIET_GREY)
    used = (left + width) / line_px + 1.5 + text_width(frames, 0.46 * line_px) / line_px
    reason = _shortened(pose.reason, pixels.shape[1] - (used + 0.5) * line_px, 0.46 * line_px)
    _write(pixels, reason, used, 1.15, line_px, WHITE)


def _status_colour(status: PoseStatus, palette: Palette) -> Colour:
    return {
        PoseStatus.OK: palette.good,
        PoseStatus.ROTATION_ONLY: palette.partial,
        PoseStatus.STATIC: palette.still,
        PoseStatus.FAILED: palette.bad,
    }[status]


def _rotation_rows(pose: RelativePose) -> list[Row]:
    if pose.rotation_cam1_from_cam0 is None or pose.rotation_covariance is None:
        return [(axis, "-", "") for axis in "xyz"]
    vector, sigma = rotation_vector_deg(pose.rotation_cam1_from_cam0, pose.rotation_covariance)
    return [
        (axis, f"{value:+.4f}", f"{spread:.4f}")
        for axis, value, spread in zip("xyz", vector, sigma, strict=True)
    ]


def _heading_rows(result: OdometryResult, pose: RelativePose) -> list[Row]:
    names = ("right", "up")
    if pose.heading_cam0 is None or pose.heading_covariance is None:
        return [(name, "-", "") for name in names]
    angles, sigma = heading_angles_deg(pose.heading_cam0, pose.heading_covariance)
    rows = [
        (name, f"{value:+.3f}", f"{spread:.3f}")
        for name, value, spread in zip(names, angles, sigma, strict=True)
    ]
    if result.scale is not None and result.scale_sigma is not None:
        rows.append(("length", f"{result.scale:.3f}", f"{result.scale_sigma:.3f}"))
    return rows


def _draw_table(
    pixels: np.ndarray, title: str, rows: Sequence[Row], left: float, line_px: float
) -> None:
    _write(pixels, title, left, 2.75, line_px, QUIET_GREY)
    for index, (name, value, sigma) in enumerate(rows):
        line = 3.85 + index
        _write(pixels, name, left, line, line_px, QUIET_GREY)
        # Numbers are aligned on the right, so that each digit keeps its place from frame to frame.
        _write(pixels, value, left + 6.0, line, line_px, WHITE, to_the_left=True)
        if sigma:
            _write(pixels, "+-", left + 6.4, line, line_px, QUIET_GREY)
            _write(pixels, sigma, left + 9.2, line, line_px, WHITE, to_the_left=True)


def _draw_matches(
    pixels: np.ndarray, pose: RelativePose, left: float, line_px: float, palette: Palette
) -> None:
    noise = "" if pose.noise_px is None else f", noise {pose.noise_px:.2f} px"
    stats = pose.stats
    _write(pixels, f"{stats.matches} matches{noise}", left, 2.75, line_px, QUIET_GREY)
    counts = (
        ("far", stats.far, palette.far),
        ("near", stats.near, palette.near),
        ("outliers", stats.outliers, palette.outlier),
    )
    for index, (name, count, colour) in enumerate(counts):
        line = 3.85 + index
        _write(pixels, name, left, line, line_px, colour)
        _write(pixels, str(count), left + 6.0, line, line_px, WHITE, to_the_left=True)


def _write(
    pixels: np.ndarray,
    text: str,
    left: float,
    line: float,
    line_px: float,
    colour: Colour,
    *,
    to_the_left: bool = False,
) -> None:
    """Draw a text; its baseline and its left (or right) end are given in units of ``line_px``."""
    capital = 0.46 * line_px
    start = left * line_px - (text_width(text, capital) if to_the_left else 0)
    draw_text(pixels, text, start, line * line_px, capital, colour)


def _shortened(text: str, width_px: float, capital: float) -> str:
    """The text, cut after a word if the text is wider than ``width_px``."""
    if text_width(text, capital) <= width_px:
        return text
    words = text.split()
    while words and text_width(" ".join(words) + " ...", capital) > width_px:
        words.pop()
    return " ".join(words) + " ..."
