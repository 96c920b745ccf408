"""Colours of the display, each with a meaning."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = [
    "BACKGROUND",
    "GUIDE_GREY",
    "PALETTES",
    "QUIET_GREY",
    "RED_GREEN",
    "WHITE",
    "Colour",
    "Palette",
    "PaletteName",
]

Colour = tuple[int, int, int]
"""Red, green, blue."""

PaletteName = Literal["red-green", "orange-blue"]
"""Names of the palettes."""

BACKGROUND: Colour = (22, 24, 28)
GUIDE_GREY: Colour = (62, 68, 76)
QUIET_GREY: Colour = (165, 170, 178)
WHITE: Colour = (242, 242, 242)


@dataclass(frozen=True, kw_only=True)
class Palette:
    """Colours of matches, epipole and status. Matches of different labels also differ in shape.

    Attributes
    ----------
    far, near, outlier : Colour
        Colours of matches with the labels far, near and outlier.
    heading : Colour
        Colour of the 95 % region of the epipole.
    good, partial, still, bad : Colour
        Background colours of the words OK, ROTATION_ONLY, STATIC and FAILED.
    """

    far: Colour
    near: Colour
    outlier: Colour = (172, 172, 176)
    heading: Colour = (255, 214, 64)
    good: Colour
    partial: Colour = (176, 112, 10)
    still: Colour = (50, 105, 190)
    bad: Colour = (214, 48, 49)


RED_GREEN = Palette(far=(255, 72, 60), near=(70, 220, 105), good=(30, 140, 75))
"""The colours of Burschka and Mair (2008)."""

# Far and near are distinct with any kind of colour vision: they differ in the blue-yellow axis and
# in brightness (orange and sky blue of M. Okabe, K. Ito, "Color Universal Design", 2008, a little
# brighter).
_ORANGE_BLUE = Palette(
    far=(245, 150, 20),
    near=(96, 190, 255),
    heading=(250, 240, 130),
    good=(0, 110, 170),
    still=(90, 95, 105),
    bad=(190, 70, 0),
)

PALETTES: dict[PaletteName, Palette] = {"red-green": RED_GREEN, "orange-blue": _ORANGE_BLUE}
"""Palettes by name."""
