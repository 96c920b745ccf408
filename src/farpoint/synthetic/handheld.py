"""Tracks of a handheld camera in a room of points, with errors like those of a tracker."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.geometry import so3
from farpoint.options import coerce_float, coerce_int, coerce_positive
from farpoint.tracks import Tracks

__all__ = ["HandheldTracks"]


@dataclass(frozen=True, kw_only=True, eq=False)
class HandheldTracks:
    """Tracks from exact geometry, without images. Iteration gives matches of consecutive frames.

    The camera swings slowly along and about all axes. The errors of successive matches add up along
    a track, as in a tracker.

    Attributes
    ----------
    camera : Camera
        Any camera of known image size.
    frames : int
        Number of frames, N.
    seed : int
        Seed of motion, points and errors.
    readout_s : float
        Read-out time of a frame, first row to last, s. The pose of a frame is the pose at the time
        of the middle row.
    noise_px : float
        1-sigma of the noise on each coordinate of a match, px.
    points : int
        Number of points, in a room 6 m wide and 5 m high, at depths of 1.5 to 5 m.
    fps : float
        Frames per second.
    """

    camera: Camera
    frames: int
    seed: int = 0
    readout_s: float = 0.0
    noise_px: float = 0.1
    points: int = 250
    fps: float = 30.0

    def __post_init__(self) -> None:
        if self.camera.size is None:
            raise InputError("expected a camera of known image size", field="camera")
        coerce_int(self, 1, "frames", "points")
        coerce_int(self, 0, "seed")
        coerce_positive(self, "noise_px", "fps")
        coerce_float(self, "0 or more", lambda value: value >= 0, "readout_s")

    def __len__(self) -> int:
        return self.frames

    @property
    def timestamps(self) -> np.ndarray:
        """Times (N,) of the frames, s."""
        return np.arange(self.frames) / self.fps

    @property
    def world_from_cam(self) -> np.ndarray:
        """True poses (N, 4, 4), m."""
        poses = np.tile(np.eye(4), (self.frames, 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = self._poses_at(self.timestamps)
        return poses

    def __iter__(self) -> Iterator[Tracks]:
        """Matches of each pair of consecutive frames."""
        rng = np.random.default_rng((self.seed, 2))
        count = self.points
        X = rng.uniform([-3.0, -2.5, 1.5], [3.0, 2.5, 5.0], (count, 3))
        ids, error = np.arange(count), np.zeros((count, 2))
        before = self._seen(X, 0)
        for frame in range(1, self.frames):
            now = self._seen(X, frame)
            both = np.isfinite(before + now).all(axis=1)
            more = self.noise_px * rng.normal(size=error.shape)
            yield Tracks(
                ids=ids[both],
                points0=(before + error)[both],
                points1=(now + error + more)[both],
                covariance_px2=np.tile(self.noise_px**2 * np.eye(2), (both.sum(), 1, 1)),
            )
            error += more
            # A point that has left the image and returns gets a new track id.
            ids = np.where(both, ids, ids.max() + 1 + np.arange(count))
            error[~both] = 0.0
            before = now

    def _poses_at(self, times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rotations (N, 3, 3) ``world_from_cam`` and positions (N, 3)."""
        rng = np.random.default_rng((self.seed, 1))
        rate = rng.uniform(1.5, 4.0, (2, 3))
        phase = rng.uniform(0.0, 2.0 * np.pi, (2, 3))
        swings = np.sin(rate[:, None] * times_s[:, None] + phase[:, None])
        return so3.exp([0.20, 0.25, 0.10] * swings[0]), [0.25, 0.20, 0.15] * swings[1]

    def _seen(self, X: np.ndarray, frame: int) -> np.ndarray:
        """Pixels (N, 2) of points, each when its row is read; NaN for a point out of view."""
        assert self.camera.size is not None
        width, height = self.camera.size
        pixels = np.full((len(X), 2), [0.0, 0.5 * (height - 1)])
        for _ in range(4 if self.readout_s else 1):
            late = self.readout_s * (np.nan_to_num(pixels[:, 1]) / (height - 1) - 0.5)
            R, p = self._poses_at(frame / self.fps + late)
            pixels = self.camera.project(np.einsum("nji,nj->ni", R, X - p))
        inside = (pixels > 0.0) & (pixels < [width - 1.0, height - 1.0])
        pixels[~inside.all(axis=1)] = np.nan
        return pixels
