"""Drives through a cloud of points: tracks as a perfect tracker would give them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from farpoint import Camera, PoseStatus, RelativePose, Tracks, estimate_relative_pose
from farpoint.geometry import so3
from farpoint.path.options import LensRefinementOptions, PathOptions
from farpoint.path.path import Pair, PathBuilder
from farpoint.path.point import PathPoint

CAMERA = Camera.pinhole(640, 480, 500.0, 500.0, 319.5, 239.5)


def estimate(
    points0: np.ndarray,
    points1: np.ndarray,
    covariance_px2: np.ndarray,
    seconds: float = 0.1,  # noqa: ARG001 - a global shutter
    camera: Camera = CAMERA,
) -> RelativePose:
    half_px2 = 0.5 * covariance_px2
    return estimate_relative_pose(
        points0, points1, camera, covariance0_px2=half_px2, covariance1_px2=half_px2
    )


def motion_of(tracks: Tracks, camera: Camera = CAMERA) -> RelativePose:
    return estimate(tracks.points0, tracks.points1, tracks.covariance_px2, camera=camera)


def poses_of(steps: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """``world_from_cam`` (N + 1, 4, 4) of steps and turns (N, 3) in camera axes."""
    poses = [np.eye(4)]
    for step, turn in zip(steps, turns, strict=True):
        motion = np.eye(4)
        motion[:3, :3], motion[:3, 3] = so3.exp(turn), step
        poses.append(poses[-1] @ motion)
    return np.array(poses)


def forward(count: int, length: float = 0.5, sway: float = 0.05, seed: int = 0) -> np.ndarray:
    """Steps (count, 3) ahead, of uneven length."""
    rng = np.random.default_rng((seed, 5))
    steps = rng.normal(0.0, sway * length, (count, 3))
    steps[:, 2] += length * (1.0 + 0.3 * np.sin(0.2 * np.arange(count)))
    return steps


EXACT = LensRefinementOptions(refine=False)
FPS = 10.0


class Drive:
    """A path built from tracks, with what was told after each pair."""

    def __init__(
        self,
        options: PathOptions | None = None,
        lens: LensRefinementOptions = EXACT,
        camera: Camera = CAMERA,
        fps: float = FPS,
    ) -> None:
        self.camera, self.fps = camera, fps
        self.builder = PathBuilder(partial(estimate, camera=camera), options or PathOptions(), lens)
        self.builder.pass_over(0, 0.0)
        self.points = [self.builder.now]
        self.settled = []

    def add(self, tracks: Tracks, motion: RelativePose | None = None) -> PathPoint:
        frame = len(self.points)
        times = (frame - 1) / self.fps, frame / self.fps
        pair = Pair(frame0=frame - 1, frame1=frame, time0=times[0], time1=times[1])
        motion = motion or motion_of(tracks, self.camera)
        assert motion.status is not PoseStatus.FAILED
        self.points.append(self.builder.add(self.camera, tracks, motion, pair))
        self.settled += self.builder.final_poses()
        return self.points[-1]

    def finish(self) -> Drive:
        self.settled += self.builder.remaining()
        return self


@dataclass
class Cloud:
    """Points around a path, some of which may move."""

    poses: np.ndarray
    points: np.ndarray
    noise_px: float = 0.1
    velocity: np.ndarray | None = None
    seed: int = 0

    def tracks(self) -> Iterator[Tracks]:
        """Matches of each pair of consecutive frames.

        A track goes on from where it was found, so that the noise of each pair is its own: the
        point it follows is moved along.
        """
        rng = np.random.default_rng((self.seed, 7))
        points = self.points.copy()
        alive = np.zeros(len(points), bool)
        ids = np.arange(len(points))
        next_id = len(points)
        for pose0, pose1 in zip(self.poses[:-1], self.poses[1:], strict=True):
            X0 = (points - pose0[:3, 3]) @ pose0[:3, :3]
            if self.velocity is not None:
                points = points + self.velocity
            X1 = (points - pose1[:3, 3]) @ pose1[:3, :3]
            pixels0, pixels1 = _seen(X0), _seen(X1)
            both = np.isfinite(pixels0).all(axis=1) & np.isfinite(pixels1).all(axis=1)
            zeros = both & ~alive
            ids[zeros] = next_id + np.arange(zeros.sum())
            next_id += zeros.sum()
            rows = np.flatnonzero(both)
            noise = self.noise_px * rng.normal(size=(len(rows), 2))
            found = pixels1[rows] + noise
            variance = max(self.noise_px, 0.01) ** 2
            yield Tracks(
                ids=ids[rows].copy(),
                points0=pixels0[rows],
                points1=found,
                covariance_px2=np.tile(variance * np.eye(2), (len(rows), 1, 1)),
            )
            distance = np.linalg.norm(X1[rows], axis=1)[:, None]
            points[rows] = (distance * CAMERA.unproject(found)) @ pose1[:3, :3].T + pose1[:3, 3]
            alive = both


def cloud(poses: np.ndarray, count: int = 1500, seed: int = 0, **options: object) -> Cloud:
    """Points in a tunnel around the path, 2 to 15 from it."""
    rng = np.random.default_rng((seed, 3))
    near = poses[rng.integers(0, len(poses), count), :3, 3]
    offset = rng.normal(size=(count, 3))
    offset *= (rng.uniform(2.0, 15.0, count) / np.linalg.norm(offset, axis=1))[:, None]
    return Cloud(poses=poses, points=near + offset, seed=seed, **options)


def _seen(X: np.ndarray) -> np.ndarray:
    pixels = np.full((len(X), 2), np.nan)
    ahead = X[:, 2] > 0.5
    pixels[ahead] = CAMERA.project(X[ahead])
    inside = np.all((pixels > 0.0) & (pixels < [639.0, 479.0]), axis=1)
    pixels[~inside] = np.nan
    return pixels
