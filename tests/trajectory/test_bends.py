"""Errors that all distances share: as derivatives say, and counted in the lengths that follow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drive_kit import CAMERA, cloud, estimate, forward, motion_of, poses_of

from farpoint import RelativePose, Tracks
from farpoint.geometry import so3
from farpoint.trajectory.depths import BENDS, Depths
from farpoint.trajectory.moved import Moved
from farpoint.trajectory.options import PathOptions
from farpoint.trajectory.parallax import Parallax, measure_parallax
from farpoint.trajectory.path import PathBuilder
from farpoint.trajectory.resection import Resection, resect
from farpoint.trajectory.scale import ScaleFit, fit_scale

STRONGEST = (BENDS - 3, BENDS - 2, BENDS - 1)  # of what bends: up to 0.8 sigma for a unit


INDEPENDENT = PathOptions(
    persistent_motion_share=0.0, persistent_length_share=0.0, fading_motion_share=0.0
)


class Second:
    """The second of two motions, and what the first has told of the distances."""

    def __init__(self) -> None:
        turns = np.array([[0.01, -0.02, 0.005], [0.0, 0.01, 0.0]])
        first, second = cloud(poses_of(forward(2), turns), noise_px=0.1, seed=4).tracks()
        motion = motion_of(first)
        parallax = measure_parallax(CAMERA, first, motion)
        unit = Moved.by(ScaleFit.unit(2.0, motion.covariance), parallax, Depths.empty())
        self.tracks: Tracks = second
        self.motion: RelativePose = motion_of(second)
        self.parallax: Parallax = measure_parallax(CAMERA, second, self.motion)
        seen = unit.carry_on(Depths.empty(), motion.direction_cam1_from_cam0)
        self.depths: Depths = seen.condense()[0]

    def bent(self, by: np.ndarray) -> Depths:
        """With other inverse distances (N,) in all."""
        return replace(self.depths, inverse=self.depths.inverse + by)

    def resected(self, by: np.ndarray) -> Resection:
        found = resect(CAMERA, self.tracks, self.motion, self.bent(by))
        assert found is not None
        return found


@pytest.fixture(scope="module")
def second() -> Second:
    return Second()


@pytest.mark.parametrize("axis", STRONGEST)
def test_a_length_follows_bent_distances_as_stated(second: Second, axis: int):
    covariance = second.motion.covariance
    fit = fit_scale(second.depths, second.parallax, covariance)
    stated = fit.by_inverse @ second.depths.bend_of(fit.ids)[:, axis]
    found = []
    for sign in (1.0, -1.0):
        bent = second.bent(0.1 * sign * second.depths.bend[:, axis])
        one = fit_scale(bent, second.parallax, covariance)
        found.append(np.array([np.log(one.scale), *one.correction]))
    derivative, sigma = (found[0] - found[1]) / 0.2, np.sqrt(np.diag(fit.covariance))
    # Weights change along, of which the statement takes no notice.
    np.testing.assert_allclose(derivative / sigma, stated / sigma, atol=0.12)


@pytest.mark.parametrize("axis", STRONGEST)
def test_a_resected_motion_follows_bent_distances_as_stated(second: Second, axis: int):
    fit, basis = second.resected(0.0).fit, second.resected(0.0).motion.direction_basis
    stated = fit.by_inverse @ second.depths.bend_of(fit.ids)[:, axis]
    found = []
    for sign in (1.0, -1.0):
        motion, length = second.resected(0.1 * sign * second.depths.bend[:, axis])
        turned = so3.log(motion.rotation_cam1_from_cam0 @ second.motion.rotation_cam1_from_cam0.T)
        way = basis.T @ motion.direction_cam1_from_cam0
        found.append(np.array([np.log(length.scale), *turned, *way]))
    derivative, sigma = (found[0] - found[1]) / 0.2, np.sqrt(np.diag(fit.covariance))
    # Weights change along, of which the statement takes no notice.
    np.testing.assert_allclose(derivative / sigma, stated / sigma, atol=0.12)


def test_what_bends_little_is_left_out_first(second: Second):
    rng = np.random.default_rng(0)
    depths = second.depths
    more = np.hstack([depths.bend, 1e-3 * rng.normal(size=(len(depths), 1)) * depths.bend])
    few, axes = replace(depths, bend=more).condense()
    assert few.bend.shape == (len(depths), BENDS)
    np.testing.assert_allclose(axes.T @ axes, np.eye(BENDS), atol=1e-12)
    whole = depths.bend @ depths.bend.T
    np.testing.assert_allclose(few.bend @ few.bend.T, whole, atol=1e-4 * whole.max())


def test_lengths_are_as_sure_as_stated_of_a_camera_that_moves_sideways():
    """A turn looks much like a step aside: such an error of a motion is one of all distances."""
    covered = []
    for seed in range(30):
        rng = np.random.default_rng((seed, 99))
        steps = rng.normal([0.3, 0.0, 0.1], 0.03, (16, 3))
        poses = poses_of(steps, rng.normal(0.0, 0.01, (16, 3)))
        builder = PathBuilder(estimate, INDEPENDENT)
        points = [
            builder.add(CAMERA, tracks, motion_of(tracks), 0.1)
            for tracks in cloud(poses, count=4000, seed=seed, noise_px=0.1).tracks()
        ]
        true = np.linalg.norm(steps, axis=1)
        errors = [
            np.log(p.scale / points[0].scale * true[0] / t)
            for p, t in zip(points, true, strict=True)
        ]
        covered += [
            abs(e) < 1.96 * p.scale_sigma / p.scale
            for e, p in zip(errors[1:], points[1:], strict=True)
        ]
    # Without what distances share it is 0.75.
    assert 0.9 < np.mean(covered) < 0.99
