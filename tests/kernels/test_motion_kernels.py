"""The fit of a motion from end to end, on exact and on shaken rays."""

from __future__ import annotations

import numpy as np
import pytest
from kernels_kit import moved, packed, two_views

from farpoint._kernels.covariance import covariance_here
from farpoint._kernels.likelihood import clutter_density, refine_pose
from farpoint._kernels.motion import MAX_SEARCHED, fit_motion, settle_motion
from farpoint.geometry import so3

SPREAD = 500.0


def told_of(view):
    """Room for what is said of each match, their labels, and how sure the pose is."""
    said = np.full((4, len(packed(np.ones(view.size)))), np.nan)
    return [said, np.full(view.size, 9, np.uint8), np.full((3, 5, 5), np.nan)]


def found(view, seed: int = 0):
    far_R, R, t, mixture = np.eye(3), np.empty((3, 3)), np.empty(3), np.empty(3)
    told = told_of(view)
    iterations, _, settled = fit_motion(
        view.pairs, view.size, 3.0, SPREAD, 1e-6, 0.99, 16, 500,
        np.array([seed], np.uint64), far_R, R, t, mixture, *told,
    )  # fmt: skip
    assert np.isfinite(settled).all()
    return R, t, mixture, iterations, settled, told


def test_the_motion_of_two_views_is_found_and_settled():
    view = two_views(1, 60, noise_rad=1e-3)
    R, t, mixture, iterations, settled, told = found(view)
    (prior, *said), labels, _ = told
    assert 16 <= iterations <= 500
    assert so3.angle_between(R, view.R) < 1e-2
    assert t @ view.t > 0.999
    residual, parallax, right = (each[: view.size] for each in said)
    assert (right > 0.9).all()
    assert (np.abs(residual) < 1.0).all()
    assert (parallax > 0.0).all()
    # All are plausible, and none is worth less than any other.
    assert prior[0] > 1.0
    np.testing.assert_allclose(prior[:60], prior[0])
    assert prior[60:].tolist() == [0.0] * (len(prior) - 60)
    _, narrowness, agreeing, odds, beyond, supporting, shows_direction = settled
    assert labels.tolist() == [2] * 60
    assert agreeing == beyond == supporting == 60
    assert odds > 100.0
    assert shows_direction
    normal = np.empty((6, 6))
    given = view.pairs, prior, view.size, SPREAD, 1e-6, 1e-3, 20
    refine_pose(*given, R.copy(), t.copy(), mixture.copy(), normal)
    around = np.linalg.slogdet(normal[:5, :5] + np.eye(5))[1]
    assert narrowness == pytest.approx(0.5 * around, rel=0.01)


def test_wrong_matches_are_told_apart():
    view = two_views(2, 60, noise_rad=1e-3)
    view.rays1[:12] = np.roll(view.rays1[:12], 1, axis=0)
    R, t, mixture, _, settled, told = found(view)
    right, labels = told[0][3, : view.size], told[1]
    assert so3.angle_between(R, view.R) < 1e-2
    assert t @ view.t > 0.99
    assert (right[12:] > 0.9).all()
    assert np.mean(right[:12] < 0.1) > 0.7
    assert 0.1 < mixture[1] < 0.3
    assert settled[2] == np.count_nonzero(labels) < 54
    assert settled[5] == np.count_nonzero(right > 0.5)


def test_a_motion_that_is_a_little_off_is_settled_where_it_was_found():
    view = two_views(4, MAX_SEARCHED, noise_rad=1e-3, error_rad=1e-3)
    R, t, mixture, _, before, told = found(view)
    off_R, off_t = moved(R, t, np.array([1e-3, -1e-3, 1e-3, 0.02, -0.02]))
    told2 = told_of(view)
    after = settle_motion(
        view.pairs, view.size, SPREAD, 1e-6,
        np.eye(3), off_R, off_t, mixture.copy(), *told2,
    )  # fmt: skip
    assert so3.angle_between(R, off_R) < 1e-4
    np.testing.assert_allclose(off_t, t, atol=1e-3)
    assert after[0] == pytest.approx(before[0], abs=0.1)
    assert (told2[1] == told[1]).mean() > 0.98


def test_of_many_matches_every_so_manieth_is_searched():
    view = two_views(5, 2 * MAX_SEARCHED, noise_rad=1e-3)
    # Wrong are some of those that are not searched.
    view.rays1[1:81:2] = np.roll(view.rays1[1:81:2], 1, axis=0)
    _, t, _, _, settled, told = found(view)
    assert t @ view.t > 0.999
    assert 2 * MAX_SEARCHED - 40 <= settled[2] < 2 * MAX_SEARCHED - 20
    assert (told[0][3, : view.size : 2] > 0.5).all()
    assert settled[5] == MAX_SEARCHED


def test_how_sure_the_motion_is_goes_by_how_many_are_right():
    view = two_views(6, 60, noise_rad=1e-3, error_rad=1e-3)
    R, t, mixture, _, settled, (said, _, sure) = found(view)
    assert settled[6]
    expected, right = np.empty((3, 5, 5)), said[3, : view.size].sum()
    clutter = clutter_density(mixture[0], mixture[1], SPREAD)
    assert covariance_here(view.pairs, said[0], R, t, mixture, clutter, right, *expected)
    np.testing.assert_allclose(sure, expected, rtol=1e-12)


def test_the_same_seed_gives_the_same_motion():
    view = two_views(3, 40, error_rad=2e-3)
    first, again = found(view, seed=5), found(view, seed=5)
    for one, other in zip(first[:4], again[:4], strict=True):
        np.testing.assert_array_equal(one, other)
