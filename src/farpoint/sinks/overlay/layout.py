"""Layout of the picture: two panes, and a panel of values below the panes."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Layout"]

_MIN_WIDTH_PX, _MAX_WIDTH_PX = 960, 1920
_STACKED_FROM_ASPECT = 1.9
_LINES_ACROSS = 42  # the picture is as wide as this many lines of text are high
_PANEL_LINES = 6.8


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Sizes in the picture, px. All sizes are even, because H.264 in 4:2:0 requires even sizes.

    Attributes
    ----------
    stacked : bool
        True if the panes are one above the other (for wide images), False if side by side.
    pane : (width, height)
        Size of each of the two panes.
    panel_height : int
        Height of the panel below the panes.
    """

    stacked: bool
    pane: tuple[int, int]
    panel_height: int

    @classmethod
    def of_image(cls, width: int, height: int) -> Layout:
        """The layout for images of this size, the same for every frame of a run."""
        stacked = width >= _STACKED_FROM_ASPECT * height
        across = 1 if stacked else 2
        total = min(max(across * width, _MIN_WIDTH_PX), _MAX_WIDTH_PX)
        pane_width = _even(total / across)
        return cls(
            stacked=stacked,
            pane=(pane_width, _even(height * pane_width / width)),
            panel_height=_even(_PANEL_LINES * across * pane_width / _LINES_ACROSS),
        )

    @property
    def width(self) -> int:
        """Width of the picture."""
        return self.pane[0] * (1 if self.stacked else 2)

    @property
    def height(self) -> int:
        """Height of the picture."""
        return self.pane[1] * (2 if self.stacked else 1) + self.panel_height

    @property
    def line_px(self) -> float:
        """Distance between lines of text."""
        return self.width / _LINES_ACROSS

    @property
    def stroke(self) -> int:
        """Width of a drawn line."""
        return max(1, round(self.width / 960))

    def pane_slices(self, index: int) -> tuple[slice, slice]:
        """Rows and columns of pane 0 (image) or 1 (flow)."""
        width, height = self.pane
        top, left = (index * height, 0) if self.stacked else (0, index * width)
        return slice(top, top + height), slice(left, left + width)


def _even(length: float) -> int:
    return max(2, 2 * round(length / 2))
