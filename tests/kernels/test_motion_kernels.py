"""The fit of a motion from end to end, on exact and on shaken rays."""

from __future__ import annotations

import numpy as np
from kernels_kit import packed, two_views

from farpoint._kernels.motion import find_motion, settle_motion
from farpoint.geometry import so3

SPREAD = 500.0


def found(view, seed: int = 0):
    far_R, R, t, mixture = np.eye(3), np.empty((3, 3)), np.empty(3), np.empty(3)
    twins = np.zeros(2, np.bool_)
    iterations = find_motion(
        view.pairs, packed(np.ones(view.size)), view.size, 3.0, SPREAD, 1e-6, 0.99, 16, 500,
        np.array([seed], np.uint64), far_R, R, t, mixture, twins,
    )  # fmt: skip
    return R, t, mixture, iterations


def settled(view, R, t, mixture):
    n = len(packed(np.ones(view.size)))
    prior, each = packed(np.ones(view.size)), np.full((3, n), np.nan)
    cost = settle_motion(view.pairs, prior, view.size, SPREAD, 1e-6, R, t, mixture, *each)
    assert np.isfinite(cost)
    return prior, each[:, : view.size]


def test_the_motion_of_two_views_is_found_and_settled():
    view = two_views(1, 60, noise_rad=1e-3)
    R, t, mixture, iterations = found(view)
    assert 16 <= iterations <= 500
    assert so3.angle_between(R, view.R) < 1e-2
    prior, (residual, parallax, right) = settled(view, R, t, mixture)
    assert t @ view.t > 0.999
    assert (right > 0.9).all()
    assert (np.abs(residual) < 1.0).all()
    assert (parallax > 0.0).all()
    # All are plausible, and none is worth less than any other.
    assert prior[0] > 1.0
    np.testing.assert_allclose(prior[:60], prior[0])
    assert prior[60:].tolist() == [0.0] * (len(prior) - 60)


def test_wrong_matches_are_told_apart():
    view = two_views(2, 60, noise_rad=1e-3)
    view.rays1[:12] = np.roll(view.rays1[:12], 1, axis=0)
    R, t, mixture, _ = found(view)
    _, (_, _, right) = settled(view, R, t, mixture)
    assert so3.angle_between(R, view.R) < 1e-2
    assert t @ view.t > 0.99
    assert (right[12:] > 0.9).all()
    assert np.mean(right[:12] < 0.1) > 0.7
    assert 0.1 < mixture[1] < 0.3


def test_the_same_seed_gives_the_same_motion():
    view = two_views(3, 40, error_rad=2e-3)
    first, again = found(view, seed=5), found(view, seed=5)
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one, other)
