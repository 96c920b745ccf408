"""The region of the epipole holds the epipole as often as it says, on the sphere and in pixels."""

from __future__ import annotations

import numpy as np
import pytest
from made_pose import draws, made_pose, true_motion, without_direction

from farpoint import Camera, RelativePose
from farpoint.errors import InputError
from farpoint.metrics import binomial_interval

CAMERA = Camera.pinhole(640, 480, 500.0, 480.0, 320.0, 240.0, (-0.05, 0.01, 1e-3, -5e-4))


def true_headings(pose: RelativePose, count: int) -> np.ndarray:
    motions = [true_motion(pose, tangent) for tangent in draws(pose, count, seed=1)]
    return np.array([-R.T @ d for R, d in motions])


def inside(points: np.ndarray, polygon: np.ndarray) -> np.ndarray:
    """Mask of points (N, 2) inside a closed convex polygon (K, 2)."""
    edges, offsets = np.diff(polygon, axis=0), points[:, None] - polygon[None, :-1]
    side = edges[:, 0] * offsets[..., 1] - edges[:, 1] * offsets[..., 0]
    return (side > 0.0).all(axis=1) | (side < 0.0).all(axis=1)


@pytest.mark.parametrize("confidence", [0.68, 0.95])
def test_the_ellipse_holds_its_share_of_true_epipoles(confidence: float):
    pose, count = made_pose(sigma_rad=0.01, seed=3), 3000
    ellipse = pose.epipole_ellipse_px(CAMERA, confidence)
    epipoles = CAMERA.project(true_headings(pose, count))
    held = int(np.count_nonzero(inside(epipoles, ellipse)))
    low, high = binomial_interval(held, count, confidence=0.999)
    assert low < confidence < high


def test_the_cap_is_closed_and_around_the_heading():
    pose = made_pose(sigma_rad=0.02)
    ring = pose.heading_region()
    np.testing.assert_allclose(ring[0], ring[-1], atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(ring, axis=1), 1.0)
    np.testing.assert_allclose(
        ring[:-1].mean(axis=0) / np.linalg.norm(ring[:-1].mean(axis=0)),
        pose.heading_cam0,
        atol=1e-12,
    )


def test_the_cap_follows_the_normal_distribution_of_two_dimensions():
    pose = made_pose(sigma_rad=1e-4)
    reach = [
        np.linalg.norm(pose.heading_region(confidence) - pose.heading_cam0, axis=1).max()
        for confidence in (0.95, 1.0 - np.exp(-0.5))  # 2.448 sigma and 1 sigma
    ]
    assert reach[0] / reach[1] == pytest.approx(2.4477, rel=1e-4)


def test_travelling_backwards_the_pinhole_shows_where_it_comes_from():
    ahead = made_pose(direction=(-0.1, 0.05, -1.0))
    backwards = made_pose(direction=(0.1, -0.05, 1.0))
    assert ahead.heading_cam0[2] > 0.0 > backwards.heading_cam0[2]
    ellipse = backwards.epipole_ellipse_px(CAMERA)
    origin = CAMERA.project(-backwards.heading_cam0[None])
    assert inside(origin, ellipse).all()
    assert np.isfinite(ahead.epipole_ellipse_px(CAMERA)).all()


def test_nothing_without_a_direction():
    pose = without_direction(made_pose())
    assert pose.heading_region() is None
    assert pose.epipole_ellipse_px(CAMERA) is None


@pytest.mark.parametrize("confidence", [0.0, 1.0, 95.0, np.nan])
def test_a_confidence_is_a_probability(confidence: float):
    with pytest.raises(InputError, match=r"^confidence: expected a probability"):
        made_pose().heading_region(confidence)
