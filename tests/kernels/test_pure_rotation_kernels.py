"""Pure rotation, and log-likelihood ratio of a translation."""

from __future__ import annotations

import numpy as np
import pytest
from kernels_kit import packed, shaken, two_views

from farpoint._kernels.constants import FAR_SHARES
from farpoint._kernels.pure_rotation import (
    MatchProbabilities,
    fit_rotation,
    flow_beside_rotation,
    translation_log_ratio,
)
from farpoint._kernels.rotation import evaluate_rotation, refine_rotation
from farpoint.geometry import so3

HALF_WIDTH = 10.0


@pytest.mark.parametrize(
    ("matches", "outlier_log_ratio", "sigma", "rounds"),
    # Many, hardly enough to estimate the noise, and a rotation without consistent matches.
    [(40, 8, 1.0, 20), (3, 0, 1.0, 20), (40, 0, 50.0, 1)],
)
def test_a_rotation_is_refined_and_its_information_is_reduced_for_unknown_labels(
    matches, outlier_log_ratio, sigma, rounds
):
    view = shaken(two_views(3, matches, baseline_m=0.0), 3, sigma)
    view.rays1[:outlier_log_ratio] = two_views(5, outlier_log_ratio).rays1
    prior = packed(np.ones(matches))
    start, begun = so3.exp(np.array([1e-3, 0.0, -1e-3])) @ view.R, np.array([0.05, 0.3, 0.05])
    given = HALF_WIDTH, 1e-6, rounds
    R, mixture, information = start.copy(), begun.copy(), np.full((3, 3), np.nan)
    computed = np.full((2, len(prior)), np.nan)
    cost, laplace_factor = fit_rotation(
        view.pairs, matches, *given, R, mixture, information, *computed
    )

    expected_R, expected, whole = start.copy(), begun.copy(), np.empty((3, 3))
    given = view.pairs, prior, matches, *given
    assert cost == pytest.approx(refine_rotation(*given, expected_R, expected, whole), rel=1e-12)
    np.testing.assert_allclose(R, expected_R, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(mixture, expected, rtol=1e-9)
    each = np.empty((2, len(prior)))
    known = evaluate_rotation(view.pairs, prior, HALF_WIDTH, R, mixture, *each)
    assert (known < 0.1) == (rounds == 1)  # else nothing is tested
    np.testing.assert_allclose(computed, each, rtol=1e-9)
    freedom = max(2.0 * each[1].sum() - 3.0, 4.0)
    share = max(known, 0.1) * (freedom - 2.0) / freedom
    np.testing.assert_allclose(information, share * whole, rtol=1e-9)
    assert laplace_factor == pytest.approx(0.5 * np.linalg.slogdet(whole + np.eye(3))[1], rel=1e-9)


def test_inliers_and_outliers_of_a_rotation_are_counted():
    rng, n, band = np.random.default_rng(0), 200, 3.0
    residual, parallax = 3.0 * rng.normal(size=(2, n))
    distance2, inlier = rng.uniform(0.0, 30.0, n), rng.uniform(0.0, 1.0, n)
    distance2[:2], inlier[:4] = 0.0, [0.1, 0.9, 0.5, 0.5]
    found = flow_beside_rotation(residual, parallax, distance2, inlier, band)

    agree, lost = np.abs(residual) <= band, inlier < 0.5
    arcs = np.arcsin(np.minimum(band / np.sqrt(np.maximum(distance2[lost], 1e-12)), 1.0)) / np.pi
    bulk = agree & (inlier > 0.5)
    expected = (
        lost.sum(),
        (lost & agree & (parallax > 0.0)).sum(),
        arcs.sum(),
        bulk.sum(),
        np.sum(residual[bulk] ** 2),
        np.sum(distance2[bulk]),
    )
    assert found == pytest.approx(expected, rel=1e-12)


def test_without_matches_all_statistics_are_zero():
    none = np.empty(0)
    assert flow_beside_rotation(none, none, none, none, 3.0) == (0, 0, 0.0, 0, 0.0, 0.0)


def gains(
    matches_by: MatchProbabilities, sigma, lift, outlier_log_ratio, share, middle, variance
) -> tuple[np.ndarray, np.ndarray]:
    """Log-likelihood ratio of a motion for each match; whether the rotation explains it too."""
    near = matches_by.inlier / (1.0 - matches_by.inlier)  # where others are, over wrong
    shift2 = (matches_by.parallax / sigma - middle) ** 2
    far = near * lift / matches_by.prior * np.exp(-0.5 * shift2 / variance) / np.sqrt(variance)
    odds = (1.0 - share) * near + share * far
    gain = outlier_log_ratio + np.log(1.0 + odds) + np.log(1.0 - matches_by.rotation_inlier)
    return gain, (odds > 1.0) & (matches_by.rotation_inlier > 0.5)


@pytest.mark.parametrize(("bulk", "far"), [(1e-6, 20), (1e-6, 52), (0.3, 20)])
@pytest.mark.parametrize("middle", [0.0, 25.0])
def test_the_evidence_for_a_motion_is_matches_that_only_it_explains(bulk, far, middle):
    rng, n, sigma, lift, outlier_log_ratio = np.random.default_rng(1), 60, 0.7, 400.0, -0.4
    parallax, inlier = 90.0 * rng.normal(size=n), rng.uniform(0.01, 0.99, n)
    rotation_inlier, prior = rng.uniform(0.01, 0.45, n), rng.uniform(1.0, 5.0, n)
    # With a high inlier probability by the rotation, matches that both explain count against the
    # motion. They have a common parallax, zero or larger, which the rotation takes up.
    rotation_inlier[:far], inlier[:far] = 1.0 - bulk, 0.9
    parallax[:far] = sigma * (middle + rng.normal(size=far))
    matches_by = MatchProbabilities(prior, parallax, inlier, rotation_inlier)
    found = translation_log_ratio(matches_by, sigma, lift, outlier_log_ratio)

    shift, expected = parallax[:far] / sigma, []
    variance = 1.0 + shift.var()
    places = np.sqrt(far / variance) * parallax[inlier > 0.5].max() / sigma
    for share in FAR_SHARES:
        for there in ((0.0, 1.0, 1.0), (shift.mean(), variance, places)):
            gain, both = gains(matches_by, sigma, lift, outlier_log_ratio, share, *there[:2])
            expected.append(gain[~both].sum() + min(gain[both].sum(), 0.0) - np.log(there[2]))
            assert (gain[both].sum() < 0.0) == (bulk < 0.1 and both.any())
    assert found == pytest.approx(max(expected) - np.log(2.0), rel=1e-12)
    if bulk < 0.1:  # else both places leave it out
        assert np.argmax(expected) % 2 == (middle > 0.0)
    if far > 50:  # it is likelier that most are
        assert np.argmax(expected) >= 2


def test_certain_matches_leave_a_finite_ratio():
    ones = np.ones(5)
    assert np.isfinite(
        translation_log_ratio(MatchProbabilities(ones, 0.0 * ones, ones, ones), 1.0, 40.0, 0.0)
    )
