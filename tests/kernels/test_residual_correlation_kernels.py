"""Correlation of residuals between neighbours."""

from __future__ import annotations

import numpy as np
import pytest
from kernels_kit import View, two_views
from scipy.spatial import cKDTree

from farpoint._kernels.residual_correlation import neighbour_correlation

MAX_QUERIED = 200


def correlation(view: View, residual: np.ndarray, inlier: np.ndarray | None = None) -> float:
    rows = np.arange(view.size) if inlier is None else np.flatnonzero(inlier > 0.5)
    rows = rows[np.argsort(view.rays0[rows, 0], kind="stable")]
    bounded = np.clip(residual[rows], -3.0, 3.0)
    return neighbour_correlation(view.pairs, rows, bounded, MAX_QUERIED)


def test_independent_noise_is_uncorrelated():
    shares = []
    for seed in range(40):
        view = two_views(seed, MAX_QUERIED, noise_rad=1e-4)
        shares.append(correlation(view, np.random.default_rng(seed).normal(size=MAX_QUERIED)))
    # 200 pairs each, some of them counted both ways.
    assert abs(np.mean(shares)) < 0.04
    assert np.std(shares) < 0.13


def test_smooth_residuals_are_correlated():
    view = two_views(1, 400, noise_rad=1e-4)
    slow = np.sin(3.0 * view.rays0[:, 0])
    assert correlation(view, 2.0 * slow) > 0.9
    noisy = slow + np.random.default_rng(1).normal(0.0, np.std(slow), 400)
    assert correlation(view, noisy) == pytest.approx(0.5, abs=0.15)


@pytest.mark.parametrize(("width", "aside"), [(1.0, 0.0), (1.0, 50.0), (1e-3, 0.0), (0.0, 0.0)])
def test_the_neighbour_is_the_nearest_inlier_in_both_images(width, aside):
    rng = np.random.default_rng(2)
    view, residual = two_views(2, MAX_QUERIED, noise_rad=1e-4), rng.normal(size=MAX_QUERIED)
    # All but one in a narrow column, and one far away.
    view.rays0[1:, 0] *= width
    view.rays0[0, 0] += aside
    inlier = np.append(1.0, rng.uniform(0.2, 1.0, MAX_QUERIED - 1))
    rows = np.flatnonzero(inlier > 0.5)
    tree = cKDTree(np.c_[view.rays0, view.rays1][rows])
    _, nearest = tree.query(tree.data, k=2)
    own, other = np.clip(residual[rows], -3.0, 3.0), np.clip(residual[rows[nearest[:, 1]]], -3, 3)
    expected = (own * other).sum() / (own * own).sum()
    assert correlation(view, residual, inlier) == pytest.approx(expected)


def test_a_point_found_twice_is_a_neighbour():
    rng = np.random.default_rng(3)
    view = two_views(3, 150, noise_rad=1e-3)
    twice = View(*(np.repeat(each, 2, axis=0) for each in view[:4]), view.R, view.t)
    residual = np.repeat(rng.normal(size=150), 2)
    assert correlation(twice, residual) == pytest.approx(1.0)


@pytest.mark.parametrize("count", [1, 2, 20])
def test_few_inliers_or_none_have_a_bounded_correlation(count):
    view = two_views(4, count)
    assert correlation(view, np.ones(count), np.zeros(count)) == 0.0
    assert -1.0 <= correlation(view, np.ones(count)) <= 1.0
    assert correlation(view, np.zeros(count)) == 0.0
