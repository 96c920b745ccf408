"""A rotation fitted from end to end, and what speaks for a translation beside it."""

from __future__ import annotations

import numpy as np
import pytest
from kernels_kit import packed, shaken, two_views

from farpoint._kernels.pure_rotation import (
    FAR_SHARES,
    MatchProbabilities,
    fit_rotation,
    flow_beside_rotation,
    translation_log_ratio,
)
from farpoint._kernels.rotation import evaluate_rotation, refine_rotation
from farpoint.geometry import so3

SPREAD = 10.0


@pytest.mark.parametrize(
    ("matches", "wrong", "sigma", "rounds"),
    # Many, hardly enough to tell the noise, and a rotation that none agrees with yet.
    [(40, 8, 1.0, 20), (3, 0, 1.0, 20), (40, 0, 50.0, 1)],
)
def test_a_rotation_is_refined_and_knows_what_it_can_of_its_matches(matches, wrong, sigma, rounds):
    view = shaken(two_views(3, matches, baseline_m=0.0), 3, sigma)
    view.rays1[:wrong] = two_views(5, wrong).rays1
    prior = packed(np.ones(matches))
    start, begun = so3.exp(np.array([1e-3, 0.0, -1e-3])) @ view.R, np.array([0.05, 0.3, 0.05])
    given = SPREAD, 1e-6, rounds
    R, mixture, information = start.copy(), begun.copy(), np.full((3, 3), np.nan)
    told = np.full((2, len(prior)), np.nan)
    cost, laplace_factor = fit_rotation(view.pairs, matches, *given, R, mixture, information, *told)

    expected_R, expected, whole = start.copy(), begun.copy(), np.empty((3, 3))
    given = view.pairs, prior, matches, *given
    assert cost == pytest.approx(refine_rotation(*given, expected_R, expected, whole), rel=1e-12)
    np.testing.assert_allclose(R, expected_R, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(mixture, expected, rtol=1e-9)
    each = np.empty((2, len(prior)))
    known = evaluate_rotation(view.pairs, prior, SPREAD, R, mixture, *each)
    assert (known < 0.1) == (rounds == 1)  # else nothing is tested
    np.testing.assert_allclose(told, each, rtol=1e-9)
    freedom = max(2.0 * each[1].sum() - 3.0, 4.0)
    share = max(known, 0.1) * (freedom - 2.0) / freedom
    np.testing.assert_allclose(information, share * whole, rtol=1e-9)
    assert laplace_factor == pytest.approx(0.5 * np.linalg.slogdet(whole + np.eye(3))[1], rel=1e-9)


def test_matches_that_a_rotation_explains_and_others_are_told_apart():
    rng, n, band = np.random.default_rng(0), 200, 3.0
    residual, parallax = 3.0 * rng.normal(size=(2, n))
    distance2, right = rng.uniform(0.0, 30.0, n), rng.uniform(0.0, 1.0, n)
    distance2[:2], right[:4] = 0.0, [0.1, 0.9, 0.5, 0.5]
    found = flow_beside_rotation(residual, parallax, distance2, right, band)

    agree, lost = np.abs(residual) <= band, right < 0.5
    arcs = np.arcsin(np.minimum(band / np.sqrt(np.maximum(distance2[lost], 1e-12)), 1.0)) / np.pi
    bulk = agree & (right > 0.5)
    expected = (
        lost.sum(),
        (lost & agree & (parallax > 0.0)).sum(),
        arcs.sum(),
        bulk.sum(),
        np.sum(residual[bulk] ** 2),
        np.sum(distance2[bulk]),
    )
    assert found == pytest.approx(expected, rel=1e-12)


def test_no_match_at_all_says_nothing():
    none = np.empty(0)
    assert flow_beside_rotation(none, none, none, none, 3.0) == (0, 0, 0.0, 0, 0.0, 0.0)


def gains(
    judged: MatchProbabilities, sigma, lift, wrong, share, middle, variance
) -> tuple[np.ndarray, np.ndarray]:
    """Of each match, the log likelihood ratio of a motion; which ones the rotation explains too."""
    near = judged.inlier / (1.0 - judged.inlier)  # where others are, over wrong
    shift2 = (judged.parallax / sigma - middle) ** 2
    far = near * lift / judged.prior * np.exp(-0.5 * shift2 / variance) / np.sqrt(variance)
    odds = (1.0 - share) * near + share * far
    gain = wrong + np.log(1.0 + odds) + np.log(1.0 - judged.rotation_inlier)
    return gain, (odds > 1.0) & (judged.rotation_inlier > 0.5)


@pytest.mark.parametrize(("bulk", "far"), [(1e-6, 20), (1e-6, 52), (0.3, 20)])
@pytest.mark.parametrize("middle", [0.0, 25.0])
def test_what_speaks_for_a_motion_are_matches_that_only_it_explains(bulk, far, middle):
    rng, n, sigma, lift, wrong = np.random.default_rng(1), 60, 0.7, 400.0, -0.4
    parallax, right = 90.0 * rng.normal(size=n), rng.uniform(0.01, 0.99, n)
    turned, prior = rng.uniform(0.01, 0.45, n), rng.uniform(1.0, 5.0, n)
    # With a small doubt of the rotation, what both explain is against the motion. It lies together,
    # at infinity or nearer, where the rotation takes its shift for its own.
    turned[:far], right[:far] = 1.0 - bulk, 0.9
    parallax[:far] = sigma * (middle + rng.normal(size=far))
    judged = MatchProbabilities(prior, parallax, right, turned)
    found = translation_log_ratio(judged, sigma, lift, wrong)

    shift, expected = parallax[:far] / sigma, []
    variance = 1.0 + shift.var()
    places = np.sqrt(far / variance) * parallax[right > 0.5].max() / sigma
    for share in FAR_SHARES:
        for there in ((0.0, 1.0, 1.0), (shift.mean(), variance, places)):
            gain, both = gains(judged, sigma, lift, wrong, share, *there[:2])
            expected.append(gain[~both].sum() + min(gain[both].sum(), 0.0) - np.log(there[2]))
            assert (gain[both].sum() < 0.0) == (bulk < 0.1 and both.any())
    assert found == pytest.approx(max(expected) - np.log(2.0), rel=1e-12)
    if bulk < 0.1:  # else both places leave it out
        assert np.argmax(expected) % 2 == (middle > 0.0)
    if far > 50:  # it is likelier that most are
        assert np.argmax(expected) >= 2


def test_matches_beyond_doubt_leave_a_number():
    ones = np.ones(5)
    assert np.isfinite(
        translation_log_ratio(MatchProbabilities(ones, 0.0 * ones, ones, ones), 1.0, 40.0, 0.0)
    )
