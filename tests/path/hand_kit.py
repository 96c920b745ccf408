"""A camera in the hand, before points of a room: tracks with the errors that trackers make."""

from __future__ import annotations

from collections.abc import Iterator

from farpoint import Camera, Tracks
from farpoint.camera import DoubleSphere, KannalaBrandt
from farpoint.synthetic import HandheldTracks

FPS = 30.0
CAMERAS = {
    "pinhole": Camera.pinhole(
        640, 480, 420.0, 420.0, 319.5, 239.5, distortion=(0.05, -0.08, 1e-3, -1e-3)
    ),
    "fisheye": Camera(
        model=KannalaBrandt(fx=300.0, fy=300.0, cx=319.5, cy=239.5, k1=0.01, k2=-0.005),
        size=(640, 480),
    ),
    "double sphere": Camera(
        model=DoubleSphere(fx=250.0, fy=250.0, cx=319.5, cy=239.5, xi=-0.2, alpha=0.6),
        size=(640, 480),
    ),
}


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
