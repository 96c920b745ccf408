"""Errors that all distances share: as derivatives say, and counted in the lengths that follow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drive_kit import CAMERA, cloud, estimate, forward, motion_of, poses_of

from farpoint import PoseStatus, RelativePose, TrackLabel, Tracks
from farpoint.geometry import so3
from farpoint.trajectory.depths import BENDS, Depths
from farpoint.trajectory.moved import Moved, MovedUnseen
from farpoint.path.options import PathOptions
from farpoint.trajectory.parallax import Parallax, measure_parallax
from farpoint.trajectory.path import PathBuilder
from farpoint.trajectory.resection import Resection, resect
from farpoint.trajectory.scale import ScaleFit, fit_scale
from farpoint.trajectory.uncertainty import SharedErrors, advance_unseen, covariance_at_rest

STRONGEST = (BENDS - 3, BENDS - 2, BENDS - 1)  # of what bends: up to 0.8 sigma for a unit


INDEPENDENT = PathOptions(
    persistent_motion_share=0.0, persistent_length_share=0.0, fading_motion_share=0.0
)

NONE_SHARED = SharedErrors(
    persistent_motion=0.0, persistent_length=0.0, fading_motion=0.0, fading_motions=1.0
)


class Second:
    """The second of two motions, and what the first has told of the distances."""

    def __init__(self) -> None:
        turns = np.array([[0.01, -0.02, 0.005], [0.0, 0.01, 0.0]])
        first, second = cloud(poses_of(forward(2), turns), noise_px=0.1, seed=4).tracks()
        motion = motion_of(first)
        parallax = measure_parallax(CAMERA, first, motion)
        unit = Moved.by(ScaleFit.unit(2.0, motion.covariance), motion, parallax, Depths.empty())
        self.tracks: Tracks = second
        self.motion: RelativePose = motion_of(second)
        self.parallax: Parallax = measure_parallax(CAMERA, second, self.motion)
        seen = unit.carry_on(Depths.empty())
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
    # Without what distances share it is 0.72.
    assert 0.9 < np.mean(covered) < 0.99


def test_a_translation_that_nobody_has_seen_bends_the_distances_as_stated(second: Second):
    sigma, rng = 1e-3, np.random.default_rng(3)
    known = second.depths
    rays0 = CAMERA.unproject(rng.uniform([0.0, 0.0], [639.0, 479.0], (len(known), 2)))
    R = so3.exp(np.array([0.02, -0.05, 0.01]))
    motion = replace(second.motion, rotation_cam1_from_cam0=R)
    unseen = MovedUnseen(ids=known.ids, rays=rays0 @ R.T, sigma=sigma)
    after = unseen.carry_on(known)
    np.testing.assert_array_equal(after.inverse, known.inverse)
    by_pose = advance_unseen(covariance_at_rest(), np.eye(4), motion, unseen, NONE_SHARED)
    np.testing.assert_allclose(by_pose[3:6, 3:6], sigma**2 * np.eye(3), atol=1e-15)
    for white in np.eye(3):
        translation = sigma * white
        moved = rays0 @ R.T + known.inverse[:, None] * translation
        true = known.inverse / np.linalg.norm(moved, axis=1)
        stated = known.inverse + after.bend[:, BENDS:] @ white
        np.testing.assert_allclose(stated, true, atol=1e-3 * np.abs(true - known.inverse).max())
        np.testing.assert_allclose(by_pose[3:6, -3:] @ white, -R.T @ translation, atol=1e-15)


def test_a_camera_may_be_anywhere_that_its_last_speed_takes_it_to():
    poses = poses_of(forward(8), np.zeros((8, 3)))
    pairs = list(cloud(poses, noise_px=0.1).tracks())
    builder = PathBuilder(estimate, INDEPENDENT)
    for tracks in pairs[:6]:
        before = builder.add(CAMERA, tracks, motion_of(tracks), 0.1)
    # Tracks of which nothing is known, and whose motion two views leave open.
    lost = replace(pairs[6], ids=pairs[6].ids + 10**6)
    motion = motion_of(pairs[6])
    turned = replace(motion, status=PoseStatus.ROTATION_ONLY, direction_cam1_from_cam0=None)
    after = builder.add(CAMERA, lost, turned, 0.1)
    np.testing.assert_array_equal(after.world_from_cam[:3, 3], before.world_from_cam[:3, 3])
    grown = np.sqrt(np.diag(after.covariance - before.covariance)[3:6])
    np.testing.assert_allclose(grown, before.scale, rtol=0.01)
    # Of a camera that only turned, no point shows that it has moved.
    far = replace(turned, labels=np.where(motion.labels > 0, TrackLabel.FAR, motion.labels))
    builder = PathBuilder(estimate, INDEPENDENT)
    for tracks in pairs[:6]:
        before = builder.add(CAMERA, tracks, motion_of(tracks), 0.1)
    after = builder.add(CAMERA, lost, far, 0.1)
    np.testing.assert_array_equal(after.covariance[3:6, 3:6], before.covariance[3:6, 3:6])
