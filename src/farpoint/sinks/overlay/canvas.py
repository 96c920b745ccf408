"""Drawing in the camera's pixel coordinates, independent of the size of the picture."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

import numpy as np

from farpoint.errors import optional_import
from farpoint.sinks.kernels.discs import draw_discs
from farpoint.sinks.overlay.palette import BACKGROUND, Colour, Palette

__all__ = ["Canvas", "draw_text", "text_width"]

_SHIFT = 4  # fractional bits of OpenCV's fixed-point coordinates
_REACH_PX = 16384.0  # beyond this OpenCV's fixed-point coordinates come near to overflowing


@dataclass(frozen=True, kw_only=True, eq=False)
class Canvas:
    """A pane of the picture, drawn on in the camera's pixel coordinates.

    Attributes
    ----------
    pixels : ndarray of uint8, shape (height, width, 3)
        The pane, drawn on in place.
    scale : ndarray, shape (2,)
        Pane pixels per camera pixel, across and down.
    stroke : int
        Width of a line, pane pixels.
    palette : Palette
        Colours of the display.
    """

    pixels: np.ndarray
    scale: np.ndarray
    stroke: int
    palette: Palette

    def to_pane(self, points_px: np.ndarray) -> np.ndarray:
        """Pane coordinates of camera pixels (..., 2); (0, 0) is the first pixel's centre."""
        return (points_px + 0.5) * self.scale - 0.5

    def path(self, points_px: np.ndarray, colour: Colour, thickness: int = 0) -> None:
        """Draw a line through camera pixels (K, 2), with gaps at pixels NaN or far outside."""
        points = self.to_pane(points_px)
        near = np.all(np.abs(points) < _REACH_PX, axis=1)
        breaks = np.flatnonzero(np.diff(near)) + 1
        pieces = [piece for piece in np.split(_fixed(points), breaks) if len(piece)]
        first = 0 if near[:1].all() else 1  # drawn and undrawn pieces alternate
        self._lines(pieces[first::2], colour, thickness)

    def segments(self, ends_px: np.ndarray, colour: Colour, thickness: int = 0) -> None:
        """Draw lines between camera pixels (N, 2, 2), unless an end is NaN or far outside."""
        ends = self.to_pane(ends_px)
        ends = ends[(np.abs(ends) < _REACH_PX).all(axis=(1, 2))]
        self._lines(list(_fixed(ends)), colour, thickness)

    def dots(self, points_px: np.ndarray, colour: Colour, radius: float) -> None:
        """Draw filled discs at camera pixels (N, 2); the radius is in units of `stroke`."""
        # A frame has hundreds of dots; OpenCV would take half of the drawing time for them.
        draw_discs(self.pixels, self._seen(points_px), radius * self.stroke, colour)

    def rings(self, points_px: np.ndarray, colour: Colour, radius: float) -> None:
        """Draw circles around camera pixels (N, 2); the radius is in units of `stroke`."""
        cv2 = _cv2()
        size = int(_fixed(radius * self.stroke))
        for centre in _fixed(self._seen(points_px)).tolist():
            cv2.circle(self.pixels, centre, size, colour, self.stroke, cv2.LINE_AA, _SHIFT)

    def holes(self, points_px: np.ndarray, colour: Colour, radius: float) -> None:
        """Draw dark-centred discs at camera pixels (N, 2); the radius is in units of `stroke`."""
        self.dots(points_px, colour, radius)
        self.dots(points_px, BACKGROUND, 0.5 * radius)

    def crosses(
        self, points_px: np.ndarray, colour: Colour, reach: float, *, slanting: bool = False
    ) -> None:
        """Draw upright or slanting crosses at camera pixels (N, 2).

        ``reach`` is the length of an arm in units of `stroke`.
        """
        arm = reach * self.stroke / self.scale
        arms = np.array([[1.0, 1.0], [1.0, -1.0]]) * np.sqrt(0.5) if slanting else np.eye(2)
        for offset in arm * arms:
            self.segments(np.stack([points_px - offset, points_px + offset], axis=1), colour)

    def _lines(self, lines: list[np.ndarray], colour: Colour, thickness: int) -> None:
        cv2 = _cv2()
        thickness = thickness or self.stroke
        cv2.polylines(self.pixels, lines, False, colour, thickness, cv2.LINE_AA, _SHIFT)

    def _seen(self, points_px: np.ndarray) -> np.ndarray:
        """Pane coordinates of those camera pixels (N, 2) that are neither NaN nor far outside."""
        points = self.to_pane(points_px)
        return points[(np.abs(points) < _REACH_PX).all(axis=1)]


def draw_text(
    pixels: np.ndarray,
    text: str,
    left: float,
    baseline: float,
    height: float,
    colour: Colour,
    *,
    bold: bool = False,
) -> None:
    """Write on pixels (H, W, 3); `height` is the height of a capital letter, px."""
    cv2 = _cv2()
    font = cv2.FONT_HERSHEY_DUPLEX if bold else cv2.FONT_HERSHEY_SIMPLEX
    place = (round(left), round(baseline))
    thickness = max(1, round(height / 14))
    cv2.putText(pixels, text, place, font, _size(height), colour, thickness, cv2.LINE_AA)


def text_width(text: str, height: float, *, bold: bool = False) -> int:
    """Width in px of a text whose capitals are `height` px high."""
    cv2 = _cv2()
    font = cv2.FONT_HERSHEY_DUPLEX if bold else cv2.FONT_HERSHEY_SIMPLEX
    return cv2.getTextSize(text, font, _size(height), max(1, round(height / 14)))[0][0]


def _size(height: float) -> float:
    """OpenCV's font scale for capitals of this height, px; at scale 1 capitals are 22 px high."""
    return height / 22.0


def _fixed(values: np.ndarray | float) -> np.ndarray:
    with np.errstate(invalid="ignore"):  # NaN gives any integer; callers do not draw this point
        return np.rint(np.asarray(values) * (1 << _SHIFT)).astype(np.int32)


def _cv2() -> ModuleType:
    return optional_import("cv2", extra="video", purpose="drawing the overlay")
