"""Tracks: image points followed from frame to frame."""

from farpoint.tracks.tracks import Tracks

__all__ = ["Tracks"]
