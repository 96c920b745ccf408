"""A drive through streets with crossings, seen by a camera of a car: tracks whose errors add up."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from farpoint import Camera, Tracks
from farpoint.geometry import so3

SIZE = 1241, 376
FPS = 10.0
STEP_M = 0.8
# Where the car turns, over which way, m, and by how much, deg.
TURNS = ((120.0, 60.0, 54.0), (260.0, 20.0, -90.0), (400.0, 20.0, 90.0), (480.0, 50.0, -40.0))
PER_FRAME, AT_ONCE = 25, 450  # points along the way; tracks


class StreetDrive:
    """Poses of a drive at 8 m/s on springs, and its tracks."""

    def __init__(self, camera: Camera, frames: int, seed: int, noise_px: float = 0.1) -> None:
        self.camera, self.frames, self.seed, self.noise_px = camera, frames, seed, noise_px
        way, yaw = STEP_M * np.arange(frames), np.zeros(frames)
        for start, over, degrees in TURNS:
            yaw += np.radians(degrees) * np.clip((way - start) / over, 0.0, 1.0)
        self._ahead = np.stack([np.sin(yaw), np.zeros(frames), np.cos(yaw)], axis=1)
        t, swing = np.arange(frames) / FPS, np.radians(0.25)
        sway = [swing * np.sin(8.2 * t), np.zeros(frames), swing * np.sin(5.7 * t + 1.0)]
        about_y = np.stack([np.zeros(frames), yaw, np.zeros(frames)], axis=1)
        self.R = so3.exp(about_y) @ so3.exp(np.stack(sway, axis=1))
        self.p = np.vstack([np.zeros(3), np.cumsum(STEP_M * self._ahead, axis=0)[:-1]])
        self.p[:, 1] += 0.02 * np.sin(8.2 * t)

    def __iter__(self) -> Iterator[Tracks]:
        """Matches of each pair of consecutive frames."""
        rng = np.random.default_rng((self.seed, 6))
        X = self._points(rng)
        ids, error = np.arange(len(X)), np.zeros((len(X), 2))
        tracked, before = np.zeros(len(X), bool), self._seen(X, 0)
        for frame in range(1, self.frames):
            now, visible = self._seen(X, frame), np.isfinite(before[:, 0])
            tracked &= visible
            fresh = np.flatnonzero(visible & ~tracked)
            tracked[fresh[: max(AT_ONCE - tracked.sum(), 0)]] = True
            found = tracked & np.isfinite(now[:, 0]) & (rng.uniform(size=len(X)) > 0.03)
            more = self.noise_px * rng.normal(size=error.shape)
            yield Tracks(
                ids=ids[found].copy(),
                points0=(before + error)[found],
                points1=(now + error + more)[found],
                covariance_px2=np.tile(self.noise_px**2 * np.eye(2), (found.sum(), 1, 1)),
            )
            error += more
            ids = np.where(found, ids, ids.max() + 1 + np.arange(len(ids)))
            error[~found] = 0.0
            tracked, before = found, now

    def _points(self, rng: np.random.Generator) -> np.ndarray:
        """Walls on both sides, the ground, and a few things far beyond, in random order."""
        count = PER_FRAME * self.frames
        k = rng.integers(0, self.frames + 60, count)
        last = np.minimum(k, self.frames - 1)
        ahead = self._ahead[last]
        X = self.p[last] + ahead * (STEP_M * (k - last))[:, None]
        side = np.stack([ahead[:, 2], np.zeros(count), -ahead[:, 0]], axis=1)
        aside, below = rng.uniform(5.0, 14.0, count), rng.uniform(-7.0, 1.6, count)
        kind = rng.uniform(size=count)
        aside = np.where(kind > 0.95, 9.0 * aside, aside) * rng.choice([-1.0, 1.0], count)
        is_ground = kind < 0.3
        aside[is_ground], below[is_ground] = rng.uniform(-6.0, 6.0, is_ground.sum()), 1.65
        X += side * aside[:, None]
        X[:, 1] = below
        return X

    def _seen(self, X: np.ndarray, frame: int) -> np.ndarray:
        """Pixels (N, 2); NaN outside the image."""
        in_camera = (X - self.p[frame]) @ self.R[frame]
        pixels = self.camera.project(in_camera)
        inside = ((pixels > 2.0) & (pixels < np.array(SIZE) - 3.0)).all(axis=1)
        near = (in_camera[:, 2] > 2.0) & (in_camera[:, 2] < 120.0)
        pixels[~(inside & near)] = np.nan
        return pixels
