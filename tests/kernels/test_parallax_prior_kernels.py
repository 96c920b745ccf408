"""Empirical-Bayes prior of the parallax."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import poisson

from farpoint._kernels import parallax_prior
from farpoint._kernels.compile import kernel
from farpoint._kernels.constants import (
    GATE_SIGMA,
    MIN_PRIOR_TAIL,
    PARALLAX_BIN,
    PARALLAX_BINS,
    PARALLAX_FALSE_ALARM,
    PRIOR_FALL_OFF,
    UNIFORM_COUNT,
)
from farpoint._kernels.parallax_prior import fit_parallax_prior

HALF_WIDTH = 300.0
OUTLIERS = np.full(20, -100.0)


@kernel
def kth_largest(values: np.ndarray, k: int) -> float:
    return parallax_prior.kth_largest(values, k)


@kernel
def most_by_chance(expected: float, directions: float) -> int:
    return parallax_prior._chance_count(expected, directions)


def prior_of(parallax: np.ndarray, inlier: np.ndarray, sigma: float = 1.0) -> np.ndarray:
    prior = np.full(len(parallax), np.nan)
    fit_parallax_prior(parallax, inlier, len(parallax), sigma, sigma * HALF_WIDTH, prior)
    return prior


def prior_at(probes: np.ndarray, inlier: np.ndarray, sigma: float = 1.0) -> np.ndarray:
    """Prior of one more match at each probe, given these inliers and some outliers."""
    is_inlier = np.r_[np.ones(len(inlier)), np.zeros(len(OUTLIERS) + 1)]
    return np.array([prior_of(np.r_[inlier, OUTLIERS, p], is_inlier, sigma)[-1] for p in probes])


def others_near(probes: np.ndarray, inlier: np.ndarray) -> np.ndarray:
    """Density of the inliers at each probe, times their number, by all pairs of both."""
    shares = shares_of(probes).T @ shares_of(inlier)
    return np.sum(shares, axis=1) / (PARALLAX_BIN * np.hypot(probes, GATE_SIGMA))


def shares_of(parallax: np.ndarray) -> np.ndarray:
    """Share (BINS, N) of each match in each bin."""
    rank = (np.arcsinh(parallax / GATE_SIGMA) + np.arcsinh(1.0)) / PARALLAX_BIN
    return np.maximum(
        1.0 - abs(np.clip(rank, 0.0, PARALLAX_BINS - 1.5) - np.arange(PARALLAX_BINS)[:, None]), 0.0
    )


def test_the_kth_largest_of_some_values():
    values = np.array([0.0, 5.0, 1.0, -1.0, 3.0, 2.0])
    for k, expected in enumerate([5.0, 3.0, 2.0, 1.0], start=1):
        assert kth_largest(values, k) == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("expected", [1e-6, 0.02, 0.3, 2.5, 40.0])
@pytest.mark.parametrize("directions", [1.0, 45.0, 31125.0])
def test_any_of_many_directions_has_more_matches_than_expected(expected, directions):
    most = most_by_chance(expected, directions)
    level = PARALLAX_FALSE_ALARM / directions
    # The bound on the tail may exceed its quantile by one.
    assert poisson.isf(level, expected) <= most <= poisson.isf(level, expected) + 1
    assert poisson.sf(most, expected) < level


def test_the_prior_is_a_histogram_of_the_other_inliers():
    far, near = np.random.default_rng(1).normal(0.0, 1.0, 60), np.linspace(40.0, 60.0, 30)
    among_far, between, among_near = prior_at(np.array([0.0, 13.0, 50.0]), np.r_[far, near])
    assert among_far > 3.0 * among_near
    assert among_near > 10.0 * between


@pytest.mark.parametrize("sigma", [1.0, 2.5])
def test_the_prior_is_the_density_of_inliers_over_that_of_outliers(sigma):
    inlier = np.random.default_rng(2).gamma(2.0, 12.0, 80)
    probes = np.linspace(-2.9, 0.8 * inlier.max(), 50)
    last, tail = beyond(inlier)
    anywhere = UNIFORM_COUNT / (last + tail + GATE_SIGMA)
    expected = 2.0 * HALF_WIDTH * (anywhere + others_near(probes, inlier)) / (UNIFORM_COUNT + 80)
    np.testing.assert_allclose(prior_at(sigma * probes, sigma * inlier, sigma), expected, rtol=1e-5)


def test_the_prior_is_never_zero():
    # A prior of 0 leaves a match out at no cost: poses with many of these would be the likeliest.
    inlier = np.random.default_rng(3).gamma(2.0, 12.0, 80)
    assert (prior_at(np.array([-1e6, 1e4, 1e9]), inlier) > 0.0).all()


def test_the_prior_integrates_to_one_match():
    inlier = np.random.default_rng(3).gamma(2.0, 12.0, 80)
    last, tail = beyond(inlier)
    probes = np.linspace(-GATE_SIGMA, last + tail, 1500)
    # The remainder is outside: before the band, and in the fall-off.
    whole = np.trapezoid(prior_at(probes, inlier), probes) / (2.0 * HALF_WIDTH)
    assert whole == pytest.approx(0.99, abs=0.02)


def test_a_match_does_not_contribute_to_its_own_prior():
    inlier = np.r_[np.linspace(1.0, 10.0, 40), 25.0, np.linspace(60.0, 80.0, 40)]
    parallax = np.r_[inlier, OUTLIERS]
    alone = prior_of(parallax, np.r_[np.ones(81), np.zeros(20)])[40]
    others = np.delete(inlier, 40)
    assert alone == pytest.approx(prior_at(np.array([25.0]), others)[0], rel=1e-6)
    # Pseudo-count 0.5 anywhere on the line, of 80 matches.
    assert alone == pytest.approx(0.5 / 80.5 * 2.0 * HALF_WIDTH / 100.0, rel=0.2)


def test_the_prior_falls_off_beyond_the_parallax_of_the_others():
    parallax = np.r_[np.linspace(0.0, 20.0, 40), 150.0]
    inlier = np.ones(41)
    inlier[::5] = 0.0
    inlier[-1] = 1.0
    prior = prior_of(parallax, inlier)
    assert np.all(prior[:40] > 600.0 / 60.0)
    assert prior[-1] < 1e-6 * prior[0]


def beyond(inlier: np.ndarray, captured: int = 4) -> tuple[float, float]:
    """The last supported parallax, and the distance of the end of the prior beyond it."""
    sizes = np.sort(inlier)[::-1]
    last = sizes[captured]
    nearer = max(sizes[2 * captured + 1] / last, np.sqrt(0.5))
    return last, max(max(nearer**-2.0 - 1.0, MIN_PRIOR_TAIL) * last, GATE_SIGMA)


@pytest.mark.parametrize(
    ("sizes", "last", "tail"),
    # The fifth from the end is the last supported parallax; the tenth is a little smaller, as
    # large, or less than half as large.
    [
        (np.arange(1.0, 61.0), 56.0, (56.0**2 / 51.0**2 - 1.0) * 56.0),
        (np.full(60, 50.0), 50.0, MIN_PRIOR_TAIL * 50.0),
        (1.3 ** np.arange(60.0), 1.3**55, 1.3**55),
    ],
)
def test_the_end_of_the_prior_depends_on_the_fall_off_of_the_density(sizes, last, tail):
    probes = last + tail * np.array([0.99, 1.0 + PRIOR_FALL_OFF, 1.0 + 5.0 * PRIOR_FALL_OFF])
    assert beyond(sizes) == pytest.approx((last, tail))
    flat = UNIFORM_COUNT / (last + tail + GATE_SIGMA) + others_near(probes, sizes)
    fading = prior_at(probes, sizes) / (flat / (UNIFORM_COUNT + 60) * 2.0 * HALF_WIDTH)
    np.testing.assert_allclose(fading, np.exp([0.0, -0.5, -12.5]), rtol=1e-3)


@pytest.mark.parametrize("sigma", [1.0, 2.5])
def test_the_prior_is_minimal_beyond_its_end(sigma):
    sizes = np.linspace(1.0, 60.0, 60)
    parallax, inlier = sigma * np.r_[sizes, OUTLIERS], np.r_[np.ones(60), np.zeros(20)]
    end = fit_parallax_prior(parallax, inlier, 80, sigma, HALF_WIDTH * sigma, np.empty(80))
    last, tail = beyond(sizes)
    assert end == pytest.approx(
        (last + (1.0 + GATE_SIGMA * PRIOR_FALL_OFF) * tail) * sigma, rel=1e-5
    )


def test_without_outliers_the_last_match_is_supported():
    prior = prior_of(np.r_[np.zeros(40), 150.0], np.ones(41))
    assert prior[-1] == pytest.approx(
        UNIFORM_COUNT / 40.5 * 2.0 * HALF_WIDTH / (2.0 * 150.0 + 3.0), rel=0.01
    )


def test_where_chance_explains_nearly_all_matches_the_prior_is_uniform():
    prior = prior_of(np.array([1.0, 2.0, 50.0, 3.0, 9.0]), np.array([1.0, 1.0, 0.0, 0.0, 0.0]))
    np.testing.assert_array_equal(prior, np.ones(5))
    whatever = np.full(3, 9.0), np.zeros(3), 3, 1.0, HALF_WIDTH, np.empty(3)
    assert fit_parallax_prior(*whatever) == np.inf
