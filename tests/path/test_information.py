"""Inverses of information matrices that are singular, or indefinite by rounding."""

from __future__ import annotations

import numpy as np

from farpoint.path.information import inverse


def test_the_inverse_of_a_definite_matrix():
    A = np.random.default_rng(1).normal(size=(6, 6))
    H = A @ A.T * np.outer(10.0 ** np.arange(6), 10.0 ** np.arange(6))
    unit = np.sqrt(np.diag(H))
    np.testing.assert_allclose(inverse(H) @ H * (unit / unit[:, None]).T, np.eye(6), atol=1e-6)


def test_what_has_no_information_has_a_large_variance_and_none_is_negative():
    H = np.diag([4.0, 0.0, 1.0])
    C = inverse(H)
    assert np.isfinite(C).all()
    assert C[1, 1] > 1e20
    np.testing.assert_allclose(C[[0, 2], [0, 2]], [0.25, 1.0])


def test_an_indefinite_matrix_has_no_negative_variance():
    H = np.eye(3)
    H[0, 1] = H[1, 0] = 1.0 + 1e-9  # correlation above 1
    C = inverse(H)
    assert np.linalg.eigvalsh(C)[0] >= 0.0
    assert C[0, 0] > 1e9  # of the difference, which has no information
    np.testing.assert_allclose(C[2, 2], 1.0)
