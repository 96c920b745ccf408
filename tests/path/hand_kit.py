"""A camera in the hand, before points of a room: tracks with the errors that trackers make."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from farpoint import Camera, Tracks
from farpoint.geometry import so3

FPS = 30.0


def poses_at(times_s: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (N, 3, 3) ``world_from_cam`` and positions (N, 3): slow swings along all axes."""
    rng = np.random.default_rng((seed, 1))
    rate = rng.uniform(1.5, 4.0, (2, 3))
    phase = rng.uniform(0.0, 2.0 * np.pi, (2, 3))
    swings = np.sin(rate[:, None] * times_s[:, None] + phase[:, None])
    return so3.exp([0.20, 0.25, 0.10] * swings[0]), [0.25, 0.20, 0.15] * swings[1]


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
    rng = np.random.default_rng((seed, 2))
    X = rng.uniform([-3.0, -2.5, 1.5], [3.0, 2.5, 5.0], (points, 3))
    ids = np.arange(points)
    error = np.zeros((points, 2))
    before = _seen(camera, X, 0, seed, readout_s)
    for frame in range(1, frames):
        now = _seen(camera, X, frame, seed, readout_s)
        both = np.isfinite(before + now).all(axis=1)
        more = noise_px * rng.normal(size=error.shape)
        yield Tracks(
            ids=ids[both],
            points0=(before + error)[both],
            points1=(now + error + more)[both],
            covariance_px2=np.tile(noise_px**2 * np.eye(2), (both.sum(), 1, 1)),
        )
        error += more
        # What has left the image comes back as another track.
        ids = np.where(both, ids, ids.max() + 1 + np.arange(points))
        error[~both] = 0.0
        before = now


def _seen(camera: Camera, X: np.ndarray, frame: int, seed: int, readout_s: float) -> np.ndarray:
    """Pixels (N, 2), each at the time its own row is read; NaN outside the image."""
    width, height = camera.size
    pixels = np.full((len(X), 2), [0.0, 0.5 * (height - 1)])
    for _ in range(4 if readout_s else 1):
        late = readout_s * (np.nan_to_num(pixels[:, 1]) / (height - 1) - 0.5)
        R, p = poses_at(frame / FPS + late, seed)
        in_cam = np.einsum("nji,nj->ni", R, X - p)
        pixels = camera.project(in_cam)
    inside = (pixels > 0.0) & (pixels < [width - 1.0, height - 1.0])
    pixels[~inside.all(axis=1)] = np.nan
    return pixels
