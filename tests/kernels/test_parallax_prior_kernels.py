"""Where along its epipolar line a right match may lie, learnt from the others."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import poisson

from farpoint._kernels import parallax_prior
from farpoint._kernels.compile import kernel
from farpoint._kernels.parallax_prior import (
    BAND_SIGMA,
    BIN,
    BINS,
    END,
    FALL_OFF,
    FALSE_ALARM_RATE,
    MIN_TAIL,
    UNIFORM_COUNT,
    fit_parallax_prior,
)

SPREAD = 300.0
WRONG = np.full(20, -100.0)


@kernel
def kth_largest(values: np.ndarray, k: int) -> float:
    return parallax_prior.kth_largest(values, k)


@kernel
def most_by_chance(expected: float, directions: float) -> int:
    return parallax_prior._chance_count(expected, directions)


def prior_of(parallax: np.ndarray, right: np.ndarray, sigma: float = 1.0) -> np.ndarray:
    prior = np.full(len(parallax), np.nan)
    fit_parallax_prior(parallax, right, len(parallax), sigma, sigma * SPREAD, prior)
    return prior


def prior_at(probes: np.ndarray, right: np.ndarray, sigma: float = 1.0) -> np.ndarray:
    """What right matches with this parallax, and some wrong ones, make plausible of one more."""
    is_right = np.r_[np.ones(len(right)), np.zeros(len(WRONG) + 1)]
    return np.array([prior_of(np.r_[right, WRONG, p], is_right, sigma)[-1] for p in probes])


def others_near(probes: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Density of the right ones at each probe, times their number, by all pairs of both."""
    shares = shares_of(probes).T @ shares_of(right)
    return np.sum(shares, axis=1) / (BIN * np.hypot(probes, BAND_SIGMA))


def shares_of(parallax: np.ndarray) -> np.ndarray:
    """How much (BINS, N) of each match is in which bin."""
    rank = (np.arcsinh(parallax / BAND_SIGMA) + np.arcsinh(1.0)) / BIN
    return np.maximum(1.0 - abs(np.clip(rank, 0.0, BINS - 1.5) - np.arange(BINS)[:, None]), 0.0)


def test_the_kth_largest_of_some_values():
    values = np.array([0.0, 5.0, 1.0, -1.0, 3.0, 2.0])
    for k, expected in enumerate([5.0, 3.0, 2.0, 1.0], start=1):
        assert kth_largest(values, k) == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("expected", [1e-6, 0.02, 0.3, 2.5, 40.0])
@pytest.mark.parametrize("directions", [1.0, 45.0, 31125.0])
def test_any_of_many_directions_has_more_matches_than_expected(expected, directions):
    most = most_by_chance(expected, directions)
    level = FALSE_ALARM_RATE / directions
    # The bound on the tail may ask for one more than its quantile.
    assert poisson.isf(level, expected) <= most <= poisson.isf(level, expected) + 1
    assert poisson.sf(most, expected) < level


def test_where_others_are_many_a_match_is_the_more_plausible():
    far, near = np.random.default_rng(1).normal(0.0, 1.0, 60), np.linspace(40.0, 60.0, 30)
    among_far, between, among_near = prior_at(np.array([0.0, 13.0, 50.0]), np.r_[far, near])
    assert among_far > 3.0 * among_near
    assert among_near > 10.0 * between


@pytest.mark.parametrize("sigma", [1.0, 2.5])
def test_the_prior_is_the_density_of_the_others_over_that_of_wrong_ones(sigma):
    right = np.random.default_rng(2).gamma(2.0, 12.0, 80)
    probes = np.linspace(-2.9, 0.8 * right.max(), 50)
    last, tail = beyond(right)
    anywhere = UNIFORM_COUNT / (last + tail + BAND_SIGMA)
    expected = 2.0 * SPREAD * (anywhere + others_near(probes, right)) / (UNIFORM_COUNT + 80)
    np.testing.assert_allclose(prior_at(sigma * probes, sigma * right, sigma), expected, rtol=1e-5)


def test_no_match_is_so_implausible_that_it_is_left_out():
    # A prior of 0 leaves a match out, and costs nothing: poses with many of those would win.
    right = np.random.default_rng(3).gamma(2.0, 12.0, 80)
    assert (prior_at(np.array([-1e6, 1e4, 1e9]), right) > 0.0).all()


def test_all_that_is_plausible_is_one_match():
    right = np.random.default_rng(3).gamma(2.0, 12.0, 80)
    last, tail = beyond(right)
    probes = np.linspace(-BAND_SIGMA, last + tail, 5000)
    # What is left of it is beyond: before the band, and where it fades.
    whole = np.trapezoid(prior_at(probes, right), probes) / (2.0 * SPREAD)
    assert whole == pytest.approx(0.99, abs=0.02)


def test_no_match_vouches_for_itself():
    right = np.r_[np.linspace(1.0, 10.0, 40), 25.0, np.linspace(60.0, 80.0, 40)]
    parallax = np.r_[right, WRONG]
    alone = prior_of(parallax, np.r_[np.ones(81), np.zeros(20)])[40]
    others = np.delete(right, 40)
    assert alone == pytest.approx(prior_at(np.array([25.0]), others)[0], rel=1e-6)
    # Half a match anywhere on the line, of 80.
    assert alone == pytest.approx(0.5 / 80.5 * 2.0 * SPREAD / 100.0, rel=0.2)


def test_a_match_much_farther_along_its_line_than_the_others_is_implausible():
    parallax = np.r_[np.linspace(0.0, 20.0, 40), 150.0]
    right = np.ones(41)
    right[::5] = 0.0
    right[-1] = 1.0
    prior = prior_of(parallax, right)
    assert np.all(prior[:40] > 600.0 / 60.0)
    assert prior[-1] < 1e-6 * prior[0]


def beyond(right: np.ndarray, captured: int = 4) -> tuple[float, float]:
    """The last match that others vouch for, and how far beyond it one may lie."""
    sizes = np.sort(right)[::-1]
    last = sizes[captured]
    nearer = max(sizes[2 * captured + 1] / last, np.sqrt(0.5))
    return last, max(max(nearer**-2.0 - 1.0, MIN_TAIL) * last, BAND_SIGMA)


@pytest.mark.parametrize(
    ("sizes", "last", "tail"),
    # The fifth from the end is the last that others vouch for; the tenth is a little nearer, as
    # far off, or less than half as far.
    [
        (np.arange(1.0, 61.0), 56.0, (56.0**2 / 51.0**2 - 1.0) * 56.0),
        (np.full(60, 50.0), 50.0, MIN_TAIL * 50.0),
        (1.3 ** np.arange(60.0), 1.3**55, 1.3**55),
    ],
)
def test_how_far_on_a_match_may_lie_tells_how_the_others_thin_out(sizes, last, tail):
    probes = last + tail * np.array([0.99, 1.0 + FALL_OFF, 1.0 + 5.0 * FALL_OFF])
    assert beyond(sizes) == pytest.approx((last, tail))
    flat = UNIFORM_COUNT / (last + tail + BAND_SIGMA) + others_near(probes, sizes)
    fading = prior_at(probes, sizes) / (flat / (UNIFORM_COUNT + 60) * 2.0 * SPREAD)
    np.testing.assert_allclose(fading, np.exp([0.0, -0.5, -12.5]), rtol=1e-3)


@pytest.mark.parametrize("sigma", [1.0, 2.5])
def test_nothing_is_plausible_beyond_its_end(sigma):
    sizes = np.linspace(1.0, 60.0, 60)
    parallax, right = sigma * np.r_[sizes, WRONG], np.r_[np.ones(60), np.zeros(20)]
    end = fit_parallax_prior(parallax, right, 80, sigma, SPREAD * sigma, np.empty(80))
    last, tail = beyond(sizes)
    assert end == pytest.approx((last + (1.0 + END * FALL_OFF) * tail) * sigma, rel=1e-5)


def test_where_no_match_is_wrong_the_last_is_no_less_plausible_than_one_of_all():
    prior = prior_of(np.r_[np.zeros(40), 150.0], np.ones(41))
    assert prior[-1] == pytest.approx(
        UNIFORM_COUNT / 40.5 * 2.0 * SPREAD / (2.0 * 150.0 + 3.0), rel=0.01
    )


def test_where_nearly_all_may_be_captured_nothing_is_known():
    prior = prior_of(np.array([1.0, 2.0, 50.0, 3.0, 9.0]), np.array([1.0, 1.0, 0.0, 0.0, 0.0]))
    np.testing.assert_array_equal(prior, np.ones(5))
    whatever = np.full(3, 9.0), np.zeros(3), 3, 1.0, SPREAD, np.empty(3)
    assert fit_parallax_prior(*whatever) == np.inf
