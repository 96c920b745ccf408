"""Matches at the ends of what floats hold: an answer or a refusal, never a variance of nothing."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
import pytest

from farpoint import Camera, PoseStatus, RelativePose
from farpoint.pose import estimate_relative_pose, estimate_relative_pose_from_rays

CAMERA = Camera.pinhole(640, 480, 500.0, 500.0, 319.5, 239.5)


def seen(count: int, noise_px: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Matches of a cloud of points, passed by."""
    rng = np.random.default_rng(seed)
    points0 = rng.uniform([20, 20], [620, 460], (count, 2))
    points = CAMERA.unproject(points0) * rng.uniform(5, 30, (count, 1))
    points1 = CAMERA.project(points + np.array([0.2, 0.0, 0.3]))
    noise = noise_px * rng.normal(size=(2, count, 2))
    return points0 + noise[0], points1 + noise[1]


def assert_honest(pose: RelativePose) -> None:
    """No variance of a result is zero, negative or not finite."""
    for covariance in (pose.covariance, pose.rotation_covariance):
        if covariance is not None:
            assert np.isfinite(covariance).all()
            assert (np.diag(covariance) > 0.0).all()
    assert (pose.covariance is not None) == (pose.status is PoseStatus.OK)


@pytest.fixture(autouse=True)
def warnings_are_errors():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


@pytest.mark.parametrize("nothing", [[], (), np.empty((0, 2)), np.empty(0, int)])
def test_no_match_at_all_is_a_failure_with_a_reason(nothing):
    for covariance in (None, [], np.empty((0, 2, 2))):
        pose = estimate_relative_pose(nothing, [], CAMERA, covariance0_px2=covariance)
        assert pose.status is PoseStatus.FAILED
        assert pose.reason
        assert len(pose.labels) == 0


@pytest.mark.parametrize("nothing", [[], np.empty((0, 3))])
def test_no_ray_at_all_is_a_failure_with_a_reason(nothing):
    pose = estimate_relative_pose_from_rays(nothing, [], noise_rad=1e-3)
    assert pose.status is PoseStatus.FAILED
    assert pose.reason


LINE = np.c_[np.linspace(50, 600, 80), np.full(80, 200.0)]


@pytest.mark.parametrize(
    "make",
    [
        *(lambda n=n: seen(n, 0.0) for n in (5, 6, 7, 8, 100)),
        *(lambda n=n: seen(n, 0.3) for n in (5, 6, 7, 8)),
        *(lambda n=n: [np.repeat(p, 20, 0) for p in seen(n, 0.2)] for n in (1, 3, 5, 8)),
        *(lambda n=n: [np.repeat(p, 20, 0) for p in seen(n, 0.0)] for n in (1, 3, 5, 8)),
        lambda: [np.full((50, 2), 100.0), np.full((50, 2), 105.0)],
        lambda: [seen(100, 0.0)[0]] * 2,
        lambda: [LINE, LINE + np.array([3.0, 1.0])],
        lambda: [LINE, 1.05 * (LINE - [320, 240]) + [320, 240]],
        *(lambda e=e: [e * p for p in seen(100, 0.2)] for e in (1e6, 1e100, 1e300, 1e-300)),
    ],
)
def test_degenerate_matches(make: Callable[[], tuple[np.ndarray, np.ndarray]]):
    assert_honest(estimate_relative_pose(*make(), CAMERA))


@pytest.mark.parametrize("part", [slice(None), slice(1), slice(None, None, 2), slice(2, None)])
@pytest.mark.parametrize("factor", [1e-320, 1e-300, 1e-30, 1e30, 1e300, 1e308])
def test_given_covariances_of_any_size(part: slice, factor: float):
    points0, points1 = seen(150, 0.2)
    covariance = np.tile(np.eye(2), (len(points0), 1, 1))
    covariance[part] *= factor
    pose = estimate_relative_pose(points0, points1, CAMERA, covariance0_px2=covariance)
    assert_honest(pose)
    stretched = np.tile(np.diag([1.0, factor]), (len(points0), 1, 1))
    both = estimate_relative_pose(
        points0, points1, CAMERA, covariance0_px2=stretched, covariance1_px2=covariance
    )
    assert_honest(both)


@pytest.mark.parametrize("length", [1e-300, 1e-200, 1e200, 1e300])
def test_rays_of_any_length(length):
    rays0, rays1 = (CAMERA.unproject(p) for p in seen(100, 0.2))
    usual = estimate_relative_pose_from_rays(rays0, rays1, noise_rad=1e-3)
    pose = estimate_relative_pose_from_rays(length * rays0, rays1 * length, noise_rad=1e-3)
    assert pose.status is usual.status is PoseStatus.OK
    np.testing.assert_allclose(
        pose.rotation_cam1_from_cam0, usual.rotation_cam1_from_cam0, atol=1e-9
    )
