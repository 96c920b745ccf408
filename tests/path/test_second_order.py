"""Positions at the unit's distance: their error along the displacement is of second order."""

from __future__ import annotations

import numpy as np
import pytest

from farpoint.path.second_order import second_order_variance


@pytest.mark.parametrize("length", [0.5, 1.0, 3.0])
def test_it_is_the_mean_square_of_what_errors_across_shorten(length):
    rng = np.random.default_rng(0)
    displacement = length * np.array([0.6, 0.0, 0.8])
    sigmas = np.array([0.02, 0.045]) * length
    across = np.array([[0.0, 1.0, 0.0], [0.8, 0.0, -0.6]])
    C = across.T @ np.diag(sigmas**2) @ across
    errors = (rng.normal(size=(100_000, 2)) * sigmas) @ across
    # The true position is at the same distance, in the direction that is off.
    true = displacement + errors
    true *= length / np.linalg.norm(true, axis=1)[:, None]
    along = (true - displacement) @ displacement / length
    expected = second_order_variance(displacement, C)
    # 1.5 % for the next order, the rest for chance.
    assert np.mean(along**2) == pytest.approx(expected[0, 0], rel=0.03)
    np.testing.assert_array_equal(expected, expected[0, 0] * np.eye(3))


def test_an_error_along_the_displacement_adds_nothing():
    displacement = np.array([0.0, 2.0, 0.0])
    assert not second_order_variance(displacement, np.diag([0.0, 0.3, 0.0])).any()
    assert not second_order_variance(np.zeros(3), np.eye(3)).any()
