"""Degrees with their 1-sigma: SciPy and random draws as the oracle."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from farpoint.geometry.angles import heading_angles_deg, rotation_vector_deg
from farpoint.geometry.sphere import normalize

DRAWS = 40_000


@pytest.mark.parametrize("angle_deg", [0.0, 0.03, 5.0, 100.0, 170.0])
def test_sigma_of_the_rotation_vector_is_the_spread_of_draws(angle_deg: float) -> None:
    rng = np.random.default_rng(1)
    R = Rotation.from_rotvec(np.deg2rad(angle_deg) * normalize(np.array([1.0, -2.0, 0.5])))
    root = np.deg2rad([[0.1, 0.0, 0.0], [0.15, 0.05, 0.0], [-0.1, 0.1, 0.2]])
    vector, sigma = rotation_vector_deg(R.as_matrix(), root @ root.T)
    drawn = Rotation.from_rotvec(rng.normal(size=(DRAWS, 3)) @ root.T) * R
    np.testing.assert_allclose(vector, np.rad2deg(R.as_rotvec()), atol=1e-9)
    np.testing.assert_allclose(sigma, np.rad2deg(drawn.as_rotvec()).std(axis=0), rtol=0.02)


@pytest.mark.parametrize("heading", [(0, 0, 1), (0.3, -0.4, 0.8), (1, 0.2, -0.5), (-1, 0, -1)])
def test_sigma_of_the_heading_is_the_spread_of_draws(heading: tuple[float, ...]) -> None:
    rng = np.random.default_rng(2)
    h = normalize(np.array(heading, float))
    root = 0.01 * (np.eye(3) - np.outer(h, h)) @ rng.normal(size=(3, 3))
    angles, sigma = heading_angles_deg(h, root @ root.T)
    drawn = normalize(h + rng.normal(size=(DRAWS, 3)) @ root.T)
    azimuth = np.rad2deg(np.arctan2(drawn[:, 0], drawn[:, 2]))
    elevation = np.rad2deg(np.arcsin(-drawn[:, 1]))
    np.testing.assert_allclose(angles, [azimuth.mean(), elevation.mean()], atol=0.05)
    np.testing.assert_allclose(sigma, [azimuth.std(), elevation.std()], rtol=0.02)


def test_right_is_positive_and_up_is_positive() -> None:
    angles, _ = heading_angles_deg(np.array([[1.0, 0, 1], [0, -1, 1]]) / np.sqrt(2), np.eye(3))
    np.testing.assert_allclose(angles, [[45, 0], [0, 45]], atol=1e-12)


def test_stacks_keep_their_gaps() -> None:
    R = np.stack([np.eye(3), np.full((3, 3), np.nan)])
    vector, sigma = rotation_vector_deg(R, np.stack([np.eye(3), np.full((3, 3), np.nan)]))
    assert np.isfinite(vector[0]).all()
    assert np.isnan(vector[1]).all()
    assert np.isnan(sigma[1]).all()
