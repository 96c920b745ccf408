"""Labels, log odds of the sign, inliers beyond a rotation, stationary matches."""

from __future__ import annotations

import math

import numpy as np
import pytest
from kernels_kit import View, packed, shaken, two_views
from scipy.stats import norm

from farpoint._kernels import evidence
from farpoint._kernels.constants import MIN_OUTLIER_PROBABILITY
from farpoint.geometry import so3, sphere


def label_matches(parallax: list[float], inlier: list[float], sigma: float = 1.0):
    labels = np.full(len(parallax), 9, np.uint8)
    agreeing, odds, _ = evidence.label_matches(
        np.array(parallax), np.array(inlier), sigma, 0.3, labels
    )
    return labels.tolist(), agreeing, odds


def test_labels_are_far_near_and_outlier():
    labels, agreeing, _ = label_matches(
        [0.0, -2.9, 2.9, 3.1, -3.1, 9.0], [1.0, 1.0, 1.0, 1.0, 1.0, 0.4]
    )
    assert labels == [1, 1, 1, 2, 0, 0]
    assert agreeing == 4


def test_parallax_counts_in_units_of_the_noise():
    assert label_matches([4.0], [1.0], sigma=2.0)[0] == [1]
    assert label_matches([7.0], [1.0], sigma=2.0)[0] == [2]


@pytest.mark.parametrize("p", [0.0, 0.7, 2.5])
def test_log_odds_of_the_sign_are_those_of_a_flow_reversed_by_noise(p):
    trust = 0.8
    forward = trust * norm.cdf(p) + 0.5 * (1.0 - trust)
    assert label_matches([p], [trust])[2] == pytest.approx(math.log(forward / (1.0 - forward)))
    assert label_matches([-p], [trust])[2] == pytest.approx(-label_matches([p], [trust])[2])


def test_the_log_odds_of_one_match_are_bounded():
    one = label_matches([50.0], [1.0])[2]
    assert one == pytest.approx(math.log(0.995 / 0.005))
    assert label_matches([50.0] * 3 + [-50.0], [1.0] * 4)[2] == pytest.approx(2 * one)


def test_log_odds_of_the_motion_to_outliers_alone():
    inlier = np.array([0.5, 0.9, 0.01, 1.0])
    *_, likelier = evidence.label_matches(np.zeros(4), inlier, 1.0, 0.25, np.empty(4, np.uint8))
    odds = 0.25 / np.array([0.5, 0.1, 0.99, MIN_OUTLIER_PROBABILITY])
    assert likelier == pytest.approx(np.log(odds).sum())


def beyond(view: View, inlier: np.ndarray, distance: float) -> tuple[int, int]:
    return evidence.count_beyond_rotation(view.pairs, packed(inlier), view.R, view.R, distance)


def test_no_match_is_beyond_the_rotation_of_a_camera_that_only_turns():
    view = shaken(two_views(1, 60, baseline_m=0.0), 1)
    assert beyond(view, np.ones(60), 6.0) == (0, 60)


def test_matches_are_counted_from_the_rotation_that_fits_them_best():
    view = shaken(two_views(1, 60, baseline_m=0.0), 1)
    off = view._replace(R=so3.exp(np.array([0.02, -0.01, 0.02])) @ view.R)  # 30 sigma
    assert beyond(off, np.ones(60), 6.0) == (0, 60)


def test_the_other_rotation_counts_where_outliers_bias_the_least_squares():
    view = shaken(two_views(1, 60, baseline_m=0.0), 1)
    view.rays1[:12] = sphere.normalize(view.rays1[:12] + np.array([0.0, 0.3, 0.0]))
    off, inlier = so3.exp(np.array([0.02, -0.01, 0.02])) @ view.R, packed(np.ones(60))
    assert evidence.count_beyond_rotation(view.pairs, inlier, off, view.R, 6.0) == (12, 60)
    assert evidence.count_beyond_rotation(view.pairs, inlier, off, off, 6.0)[0] > 40


def test_without_inliers_none_is_counted():
    assert beyond(two_views(1, 60), np.zeros(60), 6.0) == (0, 0)


def test_near_matches_are_beyond_any_rotation_and_outliers_do_not_count():
    view = two_views(2, 60, noise_rad=1e-4, baseline_m=0.3)
    count, total = beyond(view, np.ones(60), 6.0)
    assert total == 60
    assert count > 50
    still = two_views(2, 60, noise_rad=1e-4, baseline_m=0.0)
    view.rays1[10:] = still.rays1[10:]
    assert beyond(view, (np.arange(60) >= 10).astype(float), 6.0) == (0, 50)


def test_a_few_outliers_do_not_bias_the_rotation():
    view = shaken(two_views(1, 60, baseline_m=0.0), 1)
    view.rays1[:4] = two_views(5, 60).rays1[:4]  # captured, hundreds of sigma away
    assert beyond(view, np.ones(60), 6.0) == (4, 60)


@pytest.mark.parametrize("matches", [0, 5, 40])
def test_stationary_matches_are_found_by_the_noise_of_each(matches):
    view, rng = two_views(9, matches, noise_rad=1e-3), np.random.default_rng(9)
    view.rays1[:] = sphere.normalize(view.rays0 + 5e-3 * rng.normal(size=(matches, 3)))
    stationary = np.empty(matches, bool)
    count = evidence.find_stationary(view.pairs, 3.0, stationary)
    flow = np.linalg.norm(view.rays1 - view.rays0, axis=1)
    squares = (np.sum(noise**2, axis=(1, 2)) for noise in (view.noise0, view.noise1))
    expected = flow < 3.0 * np.sqrt(0.5 * sum(squares))
    np.testing.assert_array_equal(stationary, expected)
    assert count == expected.sum()
    assert matches < 40 or 5 < count < 35
