"""A camera in the hand, before points of a room: tracks with the errors that trackers make."""

from __future__ import annotations

from collections.abc import Iterator

from farpoint import Camera, Tracks
from farpoint.synthetic import HandheldTracks

FPS = 30.0


def tracks_of(
    camera: Camera,
    frames: int,
    *,
    seed: int,
    readout_s: float = 0.0,
    noise_px: float = 0.1,
    points: int = 250,
) -> Iterator[Tracks]:
    """Matches of consecutive frames; errors add up along a track, as a tracker's do."""
    return iter(
        HandheldTracks(
            camera=camera,
            frames=frames,
            seed=seed,
            readout_s=readout_s,
            noise_px=noise_px,
            points=points,
            fps=FPS,
        )
    )
