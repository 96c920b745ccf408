"""Prior odds of a match by the other matches in its part of the image."""

from __future__ import annotations

import math

import numpy as np
import pytest
from kernels_kit import View, two_views
from scipy import stats

from farpoint._kernels.clustered_outliers import odds_by_parts
from farpoint._kernels.constants import GATE_SIGMA, MIN_MATCHES, REPEATED_WIDTH_RATIO, UNIFORM_COUNT
from farpoint._kernels.image_parts import split_image

SHARE, REPEATED, SIGMA, HALF_WIDTH = 0.2, 0.1, 0.3, 300.0


def odds_of(view: View, inlier: np.ndarray, residual: np.ndarray) -> tuple[float, np.ndarray]:
    odds, mixture = np.empty(view.size), np.array([SIGMA**2, SHARE, 0.01, REPEATED])
    return odds_by_parts(view.pairs, inlier, residual, mixture, HALF_WIDTH, odds), odds


def some_matches(seed: int, count: int) -> tuple[View, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    inlier = rng.uniform(size=count)
    residual = np.where(inlier > 0.5, 0.3, 20.0) * rng.normal(size=count)
    return two_views(seed, count, noise_rad=1e-3), inlier, residual


@pytest.mark.parametrize(("count", "splits"), [(9, 0), (150, 4), (400, 5)])
def test_odds_and_log_ratio_follow_their_formulas(count, splits):
    view, inlier, residual = some_matches(count, count)
    part = np.empty(count, np.int64)
    split_image(np.ascontiguousarray(view.rays0).reshape(-1), splits, part)
    strip = (1.0 - REPEATED) / (2.0 * HALF_WIDTH)
    cauchy = stats.cauchy(scale=HALF_WIDTH / REPEATED_WIDTH_RATIO)
    expected, log_ratio = np.empty(count), 0.0
    for i in range(count):
        others = (part == part[i]) & (np.arange(count) != i)
        outlier = 1.0 - inlier[others]
        weight = inlier[others].sum() + UNIFORM_COUNT * (1.0 - SHARE)
        mean_square = (outlier * residual[others] ** 2).sum() / max(outlier.sum(), 1e-300)
        s = max(math.sqrt(mean_square), GATE_SIGMA * SIGMA)
        clutter = outlier.sum() * max(HALF_WIDTH / (math.sqrt(3.0) * s), 1.0)
        expected[i] = weight / (clutter + UNIFORM_COUNT * SHARE) * SHARE / (1.0 - SHARE)
        density = strip + REPEATED * cauchy.pdf(residual[i])
        here = stats.norm(scale=s).pdf(residual[i])
        near = outlier.sum() * here + UNIFORM_COUNT * SHARE * density
        total = others.sum() + UNIFORM_COUNT
        ratio = inlier[i] * weight / (1.0 - SHARE) + (1.0 - inlier[i]) * near / (SHARE * density)
        log_ratio += math.log(ratio / total)
    found, odds = odds_of(view, inlier, residual)
    np.testing.assert_allclose(odds, expected, rtol=1e-7)
    assert found == pytest.approx(log_ratio, abs=1e-5)


def test_parts_are_likelier_only_if_outliers_are_clustered():
    rng = np.random.default_rng(5)
    for seed in range(20):
        view = two_views(seed, 200, noise_rad=1e-3)
        residual = SIGMA * rng.normal(size=200)
        for is_clustered in (False, True):
            place = view.rays0[:, 0] if is_clustered else rng.uniform(size=200)
            wrong = np.argsort(place)[:40]
            mixed = residual.copy()
            mixed[wrong] = rng.uniform(-HALF_WIDTH, HALF_WIDTH, 40)
            inlier = np.where(np.abs(mixed) < 3.0 * SIGMA, 0.999, 1e-6)
            assert (odds_of(view, inlier, mixed)[0] > 0.0) == is_clustered


def test_among_inliers_the_odds_rise_and_among_outliers_they_fall():
    view, wide = two_views(2, 150, noise_rad=1e-3), np.full(150, HALF_WIDTH)
    assert odds_of(view, np.ones(150), np.zeros(150))[1].min() > MIN_MATCHES
    far = odds_of(view, np.zeros(150), wide)[1]
    assert far.max() < 0.05
    # The outliers of a narrow strip are the denser.
    assert odds_of(view, np.zeros(150), 0.1 * wide)[1] == pytest.approx(
        0.1 * math.sqrt(3.0) * far, rel=0.2
    )
