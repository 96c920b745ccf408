"""The fit of a motion from end to end, on exact and on shaken rays."""

from __future__ import annotations

import numpy as np
import pytest
from kernels_kit import moved, packed, two_views

from farpoint._kernels.motion import fit_motion, settle_motion
from farpoint._kernels.pairs import take_pairs
from farpoint.geometry import so3

SPREAD = 500.0


def told_of(view):
    """Room for what is learnt: which of those searched are right, and of all what is said."""
    return [*np.full((5, len(packed(np.ones(view.size)))), np.nan), np.full(view.size, 9, np.uint8)]


def found(view, seed: int = 0):
    far_R, R, t, mixture = np.eye(3), np.empty((3, 3)), np.empty(3), np.empty(3)
    told = told_of(view)
    iterations, _, settled = fit_motion(
        view.pairs, view.size, view.pairs, view.size, 3.0, SPREAD, 1e-6, 0.99, 16, 500,
        np.array([seed], np.uint64), far_R, R, t, mixture, *told,
    )  # fmt: skip
    assert np.isfinite(settled).all()
    return R, t, mixture, iterations, settled, told


def test_the_motion_of_two_views_is_found_and_settled():
    view = two_views(1, 60, noise_rad=1e-3)
    R, t, _, iterations, settled, told = found(view)
    _, prior, residual, parallax, right, labels = told
    assert 16 <= iterations <= 500
    assert so3.angle_between(R, view.R) < 1e-2
    assert t @ view.t > 0.999
    residual, parallax, right = (each[: view.size] for each in (residual, parallax, right))
    assert (right > 0.9).all()
    assert (np.abs(residual) < 1.0).all()
    assert (parallax > 0.0).all()
    # All are plausible, and none is worth less than any other.
    assert prior[0] > 1.0
    np.testing.assert_allclose(prior[:60], prior[0])
    assert prior[60:].tolist() == [0.0] * (len(prior) - 60)
    _, agreeing, odds, beyond, supporting = settled
    assert labels.tolist() == [2] * 60
    assert agreeing == beyond == supporting == 60
    assert odds > 100.0


def test_wrong_matches_are_told_apart():
    view = two_views(2, 60, noise_rad=1e-3)
    view.rays1[:12] = np.roll(view.rays1[:12], 1, axis=0)
    R, t, mixture, _, settled, told = found(view)
    right, labels = told[4][: view.size], told[5]
    assert so3.angle_between(R, view.R) < 1e-2
    assert t @ view.t > 0.99
    assert (right[12:] > 0.9).all()
    assert np.mean(right[:12] < 0.1) > 0.7
    assert 0.1 < mixture[1] < 0.3
    assert settled[1] == np.count_nonzero(labels) < 54
    assert settled[4] == np.count_nonzero(right > 0.5)


def test_a_motion_that_is_a_little_off_is_settled_where_it_was_found():
    view = two_views(4, 200, noise_rad=1e-3, error_rad=1e-3)
    R, t, mixture, _, before, told = found(view)
    off_R, off_t = moved(R, t, np.array([1e-3, -1e-3, 1e-3, 0.02, -0.02]))
    told2 = told_of(view)
    after = settle_motion(
        view.pairs, view.size, view.pairs, view.size, SPREAD, 1e-6,
        np.eye(3), off_R, off_t, mixture.copy(), *told2,
    )  # fmt: skip
    assert so3.angle_between(R, off_R) < 1e-4
    np.testing.assert_allclose(off_t, t, atol=1e-3)
    assert after[0] == pytest.approx(before[0], abs=0.1)
    assert (told2[5] == told[5]).mean() > 0.98


def test_of_many_matches_every_so_manieth_is_searched():
    view = two_views(5, 96, noise_rad=1e-3)
    rows = np.arange(48) * 96 // 48
    # Wrong are some of those that are not searched.
    view.rays1[1:24:2] = np.roll(view.rays1[1:24:2], 1, axis=0)
    some = np.empty_like(view.pairs[: len(view.pairs) // 2])
    take_pairs(view.pairs, rows, some)
    told = [np.full(48, np.nan), *told_of(view)[1:]]
    R, t, mixture, far_R = np.empty((3, 3)), np.empty(3), np.empty(3), np.eye(3)
    *_, settled = fit_motion(
        some, 48, view.pairs, 96, 3.0, SPREAD, 1e-6, 0.99, 16, 500,
        np.array([0], np.uint64), far_R, R, t, mixture, *told,
    )  # fmt: skip
    assert t @ view.t > 0.999
    assert 84 <= settled[1] < 90
    assert settled[4] == 48


def test_the_same_seed_gives_the_same_motion():
    view = two_views(3, 40, error_rad=2e-3)
    first, again = found(view, seed=5), found(view, seed=5)
    for one, other in zip(first[:4], again[:4], strict=True):
        np.testing.assert_array_equal(one, other)
