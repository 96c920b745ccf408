"""Spread, coverage and consistency, held against SciPy and against honest and dishonest claims."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from farpoint.errors import InputError
from farpoint.metrics import (
    Coverage,
    binomial_interval,
    chi2_quantile,
    consistency,
    coverage,
    nees,
    summarize,
)


@settings(max_examples=50, deadline=None)
@given(trials=st.integers(1, 2000), share=st.floats(0.0, 1.0))
def test_binomial_interval_is_scipys_exact_one(trials: int, share: float):
    successes = round(share * trials)
    theirs = stats.binomtest(successes, trials).proportion_ci(0.95, method="exact")
    assert binomial_interval(successes, trials) == pytest.approx(
        (theirs.low, theirs.high), rel=1e-9
    )


def test_nothing_is_known_without_trials():
    assert binomial_interval(0, 0) == (0.0, 1.0)
    assert np.isnan(coverage(np.empty(0), 3, 0.95).share)


@pytest.mark.parametrize("dof", [1, 2, 3, 5, 2000])
@pytest.mark.parametrize("probability", [0.025, 0.5, 0.68, 0.975])
def test_chi2_quantile_is_scipys(probability: float, dof: int):
    assert chi2_quantile(probability, dof) == pytest.approx(stats.chi2.ppf(probability, dof))


def draw(count: int, dof: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Gaussian errors, each from a full random covariance of its own."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(count, dof, dof)) * 0.01
    covariances = root @ np.swapaxes(root, 1, 2) + 1e-5 * np.eye(dof)
    errors = np.linalg.cholesky(covariances) @ rng.normal(size=(count, dof, 1))
    return errors[..., 0], covariances


def test_nees_is_the_quadratic_form():
    errors, covariances = draw(20, 5, seed=1)
    expected = [e @ np.linalg.inv(C) @ e for e, C in zip(errors, covariances, strict=True)]
    np.testing.assert_allclose(nees(errors, covariances), expected, rtol=1e-9)


def within_chance(covered: Coverage) -> bool:
    """Whether the promise may well be true: one honest run in a thousand fails this."""
    low, high = binomial_interval(covered.inside, covered.count, confidence=0.999)
    return low <= covered.level <= high


@pytest.mark.parametrize("dof", [2, 3, 5])
def test_honest_covariances_pass(dof: int):
    figures = consistency(*draw(4000, dof, seed=dof))
    assert figures.mean_nees == pytest.approx(dof, abs=3.3 * np.sqrt(2.0 * dof / 4000))
    assert within_chance(figures.coverage68)
    assert within_chance(figures.coverage95)
    assert figures.sigma_over_error == pytest.approx(1.0, abs=0.04)


def test_the_bounds_of_mean_nees_hold_19_times_in_20():
    runs = [consistency(*draw(60, 3, seed=k)) for k in range(300)]
    held = sum(run.nees_low <= run.mean_nees <= run.nees_high for run in runs)
    low, high = binomial_interval(held, len(runs), confidence=0.999)
    assert low < 0.95 < high
    assert sum(run.coverage95.kept for run in runs) > 0.93 * len(runs)


@pytest.mark.parametrize(("factor", "too_small"), [(0.9, True), (1.1, False)])
def test_ten_per_cent_of_sigma_is_noticed(factor: float, too_small: bool):
    errors, covariances = draw(4000, 5, seed=7)
    figures = consistency(errors, factor**2 * covariances)
    assert not within_chance(figures.coverage68)
    assert not within_chance(figures.coverage95)
    assert figures.sigma_over_error == pytest.approx(factor, abs=0.04)
    if too_small:
        assert figures.mean_nees > figures.nees_high
        assert figures.coverage95.high < 0.95
    else:
        assert figures.mean_nees < figures.nees_low
        assert figures.coverage95.low > 0.95


def test_a_few_wild_errors_do_not_hide_the_size_of_the_others():
    errors, covariances = draw(2000, 3, seed=9)
    errors[:20] *= 1e3
    figures = consistency(errors, covariances)
    assert figures.mean_nees > 1e3
    assert figures.sigma_over_error == pytest.approx(1.0, abs=0.05)


def test_undefined_errors_are_left_out_and_infinite_ones_are_not():
    errors, covariances = draw(4, 2, seed=3)
    errors[0] = np.nan
    covariances[1] = np.nan
    errors[2] = np.inf
    values = nees(errors, covariances)
    assert np.isnan(values[[0, 1]]).all()
    assert values[2] == np.inf
    assert np.isfinite(values[3])
    assert coverage(values, 2, 0.95).count == 2
    assert consistency(errors, covariances).mean_nees == np.inf


def test_a_covariance_that_is_none_is_refused():
    errors, covariances = draw(3, 3, seed=3)
    covariances[1] = np.diag([1.0, 1.0, 0.0])
    with pytest.raises(InputError, match=r"covariances\[1\]: expected a positive definite"):
        nees(errors, covariances)


def test_summary_figures():
    summary = summarize(np.array([3.0, np.nan, 1.0, 2.0, -4.0]))
    assert summary.count == 4
    assert summary.mean == 0.5
    assert summary.median == 1.5
    assert summary.rmse == pytest.approx(np.sqrt(7.5))
    assert summary.max == summary.p95 == 3.0
    assert summarize(np.arange(1.0, 101.0)).p95 == 95.0
    assert summarize(np.array([2.0])).scaled(3.0).rmse == 6.0


def test_no_errors_have_no_figures():
    summary = summarize(np.array([np.nan]))
    assert summary.count == 0
    assert np.isnan(summary.rmse)
    assert consistency(np.empty((0, 3)), np.empty((0, 3, 3))).count == 0


def test_coverage_counts():
    assert coverage(np.array([0.1, 0.2, 9.0, np.nan]), 2, 0.95) == Coverage(
        level=0.95,
        inside=2,
        count=3,
        low=pytest.approx(0.0943, abs=1e-4),
        high=pytest.approx(0.9916, abs=1e-4),
    )
