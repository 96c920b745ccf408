"""Classification of matches by two motions and outliers, against plain NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from farpoint._kernels.classification import classify
from farpoint._kernels.constants import EM_ROUNDS

TINY_SHARE = 1e-12


def by_numpy(densities: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Responsibilities (3, N) and log likelihoods (N,) of the mixture."""
    largest = densities.max(axis=0)
    shares, scaled = np.full(3, 1.0 / 3.0), np.exp(densities - largest)
    for _ in range(EM_ROUNDS):
        weighted = shares[:, None] * scaled
        responsibility = weighted / weighted.sum(axis=0)
        log_likelihoods = np.log(weighted.sum(axis=0)) + largest
        shares = np.maximum(responsibility.mean(axis=1), TINY_SHARE)
    return responsibility, log_likelihoods


def classified(densities: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    follows, log_likelihoods = np.empty(densities.shape[1], np.int64), np.empty(densities.shape[1])
    classify(densities.copy(), follows, log_likelihoods)
    return follows, log_likelihoods


@pytest.mark.parametrize("scatter", [0.1, 3.0, 300.0])
def test_it_is_the_mixture_minus_the_entropy(scatter: float):
    densities = np.random.default_rng(1).normal(-2.0, scatter, (3, 200))
    follows, found = classified(densities)
    responsibility, log_likelihoods = by_numpy(densities)
    entropy = -np.sum(responsibility * np.log(np.maximum(responsibility, TINY_SHARE)), axis=0)
    np.testing.assert_array_equal(follows, np.argmax(responsibility, axis=0))
    np.testing.assert_allclose(found, log_likelihoods - entropy, rtol=1e-10, atol=1e-10)


def test_two_equal_motions_explain_no_more_than_two_that_separate_the_matches():
    separate = np.full((3, 40), -50.0)
    separate[0, :20] = separate[1, 20:] = 0.0
    either = separate.copy()
    either[:2] = 0.0
    follows, alone = classified(separate)
    np.testing.assert_array_equal(follows, np.repeat([0, 1], 20))
    np.testing.assert_allclose(alone, -np.log(2.0), atol=1e-9)
    # Their mixture is twice as likely, and its entropy is log 2.
    np.testing.assert_allclose(classified(either)[1], alone, atol=1e-9)
