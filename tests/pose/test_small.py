"""Single matrices in plain numbers, beside what NumPy and the geometry make of them."""

from __future__ import annotations

import numpy as np
import pytest

from farpoint.pose.small import inverse_three, size2


def test_the_inverse_of_a_covariance():
    rng = np.random.default_rng(0)
    for _ in range(20):
        A = rng.normal(size=(3, 3))
        covariance = A @ A.T + 0.1 * np.eye(3)
        inverse = inverse_three(covariance)
        assert inverse is not None
        np.testing.assert_allclose(inverse, np.linalg.inv(covariance), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    "diagonal",
    [
        (1.0, 1.0, 0.0),
        (1.0, -1.0, -1.0),
        (-1.0, -1.0, 1.0),
        (np.inf, 1.0, 1.0),
        (np.nan, 1.0, 1.0),
        (1e103, 1e103, 1e103),
    ],
)
def test_what_has_no_inverse_has_none(diagonal):
    assert inverse_three(np.diag(diagonal)) is None


def test_a_matrix_that_is_nearly_flat_has_none():
    assert inverse_three(np.ones((3, 3)) + 1e-9 * np.eye(3)) is None


def test_how_far_three_numbers_are_off_in_units_of_their_covariance():
    rng = np.random.default_rng(1)
    for _ in range(20):
        A, steps = rng.normal(size=(3, 3)) + 2.0 * np.eye(3), rng.normal(size=3)
        x, y, z = (A @ steps).tolist()
        assert size2((x, y, z), A @ A.T) == pytest.approx(steps @ steps, rel=1e-6)


def test_numbers_are_as_far_off_where_their_covariance_is_nearly_flat():
    flat = 1e-9
    covariance = np.array([[1.0, 1.0 - flat, 0.0], [1.0 - flat, 1.0, 0.0], [0.0, 0.0, 1.0]])
    assert inverse_three(covariance) is None
    across = (0.5 * flat) ** 0.5
    assert size2((across, -across, 2.0), covariance) == pytest.approx(1.0 + 4.0, rel=1e-6)
