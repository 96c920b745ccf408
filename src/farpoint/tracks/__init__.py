"""Tracks: image points followed from frame to frame."""

from farpoint.tracks.options import (
    CornerOptions,
    LucasKanadeOptions,
    RefinementOptions,
    TrackerOptions,
)
from farpoint.tracks.region import trackable_region, unmasked_region
from farpoint.tracks.tracker import Tracker, grey_size
from farpoint.tracks.tracks import Tracks

__all__ = [
    "CornerOptions",
    "LucasKanadeOptions",
    "RefinementOptions",
    "Tracker",
    "TrackerOptions",
    "Tracks",
    "grey_size",
    "trackable_region",
    "unmasked_region",
]
