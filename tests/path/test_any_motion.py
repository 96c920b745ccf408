"""Any motion and scene, with tracks that end and go wrong: sound poses and covariances."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from drive_kit import estimate
from hand_kit import CAMERAS, FPS

from farpoint import PoseStatus, Tracks
from farpoint.bench.lens_trials import calibrated_wrong
from farpoint.geometry import so3
from farpoint.path.options import LensRefinementOptions, PathOptions
from farpoint.path.path import Pair, PathBuilder
from farpoint.path.point import PathPoint

POINTS, LEAST = 400, 1e-30
SCENES = ("room", "ahead", "turn", "stops", "rests first", "slope")


class Recording:
    """A random motion of a random camera through random points, with faults."""

    def __init__(self, seed: int) -> None:
        self.rng = rng = np.random.default_rng((seed, 77))
        self.true = list(CAMERAS.values())[rng.integers(len(CAMERAS))]
        self.noise_px = 10 ** rng.uniform(-2.0, -0.2)
        self.wrong = rng.choice([0.0, 0.3]) * rng.uniform()
        scene, frames = rng.choice(SCENES), int(rng.integers(60, 120))
        knots = rng.normal(size=(9, 6))
        times = np.linspace(0.0, 8.0, frames)
        swings = np.stack([np.interp(times, np.arange(9), knot) for knot in knots.T], axis=1)
        turns = 10 ** rng.uniform(-2.0, 0.0) * swings[:, :3]
        self.p = 10 ** rng.uniform(-2.5, 0.8) * swings[:, 3:]
        self.X = rng.uniform([-6.0, -5.0, 0.3], [6.0, 5.0, 12.0], (POINTS, 3))
        if scene == "ahead":
            self.p[:, 2] += np.linspace(0.0, 10 ** rng.uniform(0.0, 1.7), frames)
            self.X[:, 2] = rng.uniform(0.5, 60.0, POINTS)
        if scene == "turn":
            self.p[:] = self.p[0]
        if scene == "stops":
            self.p[frames // 2 :], turns[frames // 2 :] = self.p[frames // 2], turns[frames // 2]
        if scene == "rests first":
            self.p[: frames // 3], turns[: frames // 3] = self.p[frames // 3], turns[frames // 3]
        if scene == "slope":
            self.X[:, 2] = 4.0 + 0.3 * self.X[:, 0]
        self.X *= rng.choice([1.0, 50.0], p=[0.8, 0.2])
        self.R = so3.exp(turns)

    def __iter__(self) -> Iterator[Tracks]:
        """Matches of each pair of consecutive frames."""
        rng, ids, error = self.rng, np.arange(POINTS), np.zeros((POINTS, 2))
        before = self._seen(0)
        for frame in range(1, len(self.p)):
            now = self._seen(frame)
            found = np.isfinite(before + now).all(axis=1) & (rng.uniform(size=POINTS) > 0.03)
            more = self.noise_px * rng.normal(size=(POINTS, 2))
            more[rng.uniform(size=POINTS) < self.wrong] *= 20.0 / self.noise_px
            yield Tracks(
                ids=ids[found],
                points0=(before + error)[found],
                points1=(now + error + more)[found],
                covariance_px2=np.tile(self.noise_px**2 * np.eye(2), (found.sum(), 1, 1)),
            )
            error = np.where(found[:, None], error + more, 0.0)
            ids = np.where(found, ids, ids.max() + 1 + np.arange(POINTS))
            before = now

    def _seen(self, frame: int) -> np.ndarray:
        pixels = self.true.project((self.X - self.p[frame]) @ self.R[frame])
        inside = ((pixels > 0.0) & (pixels < np.array(self.true.size) - 1.0)).all(axis=1)
        pixels[~inside] = np.nan
        return pixels


def path_of(recording: Recording) -> Iterator[PathPoint]:
    """The path by a lens that was calibrated wrong; some frames are missing."""
    rng, lens = recording.rng, LensRefinementOptions()
    error = rng.choice(["drawn", "two sigmas"])
    given = calibrated_wrong(recording.true, error, rng, lens)

    def motion(
        points0: np.ndarray, points1: np.ndarray, covariance_px2: np.ndarray, seconds: float
    ):
        return estimate(points0, points1, covariance_px2, seconds, given)

    path = PathBuilder(motion, PathOptions(), lens)
    path.pass_over(0, 0.0)
    for frame, tracks in enumerate(recording, start=1):
        seconds = 1.0 / FPS
        found = motion(tracks.points0, tracks.points1, tracks.covariance_px2, seconds)
        if rng.uniform() < 0.01:
            path.break_off()
        if found.status is PoseStatus.FAILED:
            path.break_off()
            path.pass_over(frame, frame / FPS)
            continue
        times = (frame - 1) / FPS, frame / FPS
        pair = Pair(frame0=frame - 1, frame1=frame, time0=times[0], time1=times[1])
        yield path.add(given, tracks, found, pair)
        path.final_poses()
        path.report()
    path.remaining()


@pytest.mark.parametrize("seed", range(60, 84))
def test_poses_and_covariances_are_sound(seed):
    for point in path_of(Recording(seed)):
        assert np.isfinite(point.world_from_cam).all()
        assert not np.isnan(point.covariance).any()
        if np.isfinite(point.covariance).all():
            sigma = np.sqrt(np.maximum(np.diag(point.covariance), LEAST))
            correlation = point.covariance / np.outer(sigma, sigma)
            assert np.linalg.eigvalsh(correlation)[0] > -1e-6


@pytest.mark.parametrize("seed", [79, 82, 98])
def test_a_path_does_not_depend_on_what_was_in_memory(seed):
    paths = []
    for value in (0.0, 1e3):
        left = [np.full(count, value) for count in (6, 36, 64, 600, 1200, 2400, 5000)]
        del left
        points = list(path_of(Recording(seed)))
        paths.append([np.append(point.world_from_cam, point.covariance) for point in points])
    np.testing.assert_array_equal(*paths)
