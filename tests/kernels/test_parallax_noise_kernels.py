"""Noise that scales with parallax is found where it is, and only there."""

from __future__ import annotations

import os

import numpy as np
import pytest
from kernels_kit import View, packed, rays_only

from farpoint._kernels.constants import (
    COVARIANCE0,
    FLOW,
    LANES,
    LONGEST_PARALLAX_LENGTH,
    PANEL,
    PARALLAX_LENGTHS,
)
from farpoint._kernels.parallax_noise import scale_noise_with_parallax

MATCHES = 400
SIGMA = 0.3


def any_rays(matches: int = MATCHES) -> View:
    """Rays with isotropic noise of one radian."""
    rays = np.random.default_rng(9).normal(size=(2, matches, 3))
    return rays_only(*(rays / np.linalg.norm(rays, axis=2, keepdims=True)))


def samples(rng: np.random.Generator, length: float, matches: int = MATCHES) -> tuple:
    """Residual, parallax and inlier probability for unit noise that scales with this length."""
    parallax = 10.0 * rng.exponential(size=matches)
    variance = np.sqrt(1.0 + (parallax / length) ** 2)
    residual = SIGMA * np.sqrt(variance) * rng.normal(size=matches)
    # Some inliers are of the tail; outliers have parallax and residual of any size.
    residual[::10] *= np.sqrt(8.0)
    inlier = np.ones(matches)
    inlier[::7] = 0.1
    residual[::7], parallax[::7] = 100.0 * rng.normal(size=(2, len(inlier[::7])))
    return residual, parallax, inlier


def scaled_pairs(view: View, residual, parallax, inlier) -> np.ndarray | None:
    """Factors of the variances (N,), or None for constant noise."""
    pairs = view.pairs
    out = np.full_like(pairs, np.nan)
    given = packed(residual), packed(parallax), packed(inlier)
    for each in given:
        each[view.size :] = np.nan  # of no match: whatever it may be
    if not scale_noise_with_parallax(pairs, *given, view.size, SIGMA**2, out):
        assert np.isnan(out).all()
        return None
    rows = np.arange(view.size) // LANES, slice(None), np.arange(view.size) % LANES
    before, after = (each.reshape(-1, PANEL // LANES, LANES)[rows] for each in (pairs, out))
    factors = after[:, FLOW] / before[:, FLOW]
    expected = before * np.where(np.arange(FLOW + 1) < COVARIANCE0, 1.0, factors[:, None])
    np.testing.assert_allclose(after, expected, rtol=1e-12)
    return factors


@pytest.mark.parametrize("length", [1.5, 2.5, 4.0])
def test_noise_that_scales_is_found_with_its_length(length):
    rng = np.random.default_rng(0)
    view = any_rays()
    slopes = []
    for _ in range(20):
        residual, parallax, inlier = samples(rng, length)
        factors = scaled_pairs(view, residual, parallax, inlier)
        if factors is None:
            continue
        used = inlier > 0.5
        assert np.mean(np.log(factors[used])) == pytest.approx(0.0, abs=1e-6)
        # 1 / length^2, from any two matches.
        far, near = np.argmin(np.abs(parallax)), np.argmax(np.abs(parallax))
        square = (factors[near] / factors[far]) ** 2
        slopes.append(square / parallax[near] ** 2)
    assert len(slopes) >= 18
    # Each length is half of the previous one.
    assert 0.4 * length < np.median(slopes) ** -0.5 < 2.2 * length


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="takes 12 s")
def test_constant_noise_is_not_scaled():
    rng = np.random.default_rng(1)
    view = any_rays()
    # False-alarm rate 1 in 2000: more than two in 500 have a probability of 0.2 %.
    assert sum(scaled_pairs(view, *samples(rng, 1e9)) is not None for _ in range(500)) <= 2


def test_noise_that_decreases_with_parallax_is_not_scaled():
    rng = np.random.default_rng(2)
    residual, parallax, inlier = samples(rng, 1e9)
    residual /= 1.0 + parallax**2
    assert scaled_pairs(any_rays(), residual, parallax, inlier) is None


def test_few_far_matches_do_not_fix_the_noise_below_the_length():
    rng = np.random.default_rng(3)
    residual = SIGMA * rng.normal(size=MATCHES)
    parallax, inlier = 10.0 + rng.uniform(0.0, 1.0, MATCHES), np.ones(MATCHES)
    for far, shows in ((36, False), (44, True)):  # at least 10 % must be nearer
        parallax[:far] = 0.01
        residual[:far] = 0.01 * SIGMA
        assert (scaled_pairs(any_rays(), residual, parallax, inlier) is not None) == shows


def test_residuals_have_a_lower_bound():
    rng = np.random.default_rng(5)
    residual, parallax = SIGMA * rng.normal(size=MATCHES), np.linspace(0.1, 30.0, MATCHES)
    residual[:12] = 1e-12
    assert scaled_pairs(any_rays(), residual, parallax, np.ones(MATCHES)) is None


def test_few_matches_and_exact_ones_show_nothing():
    view = any_rays(40)
    parallax = np.linspace(1.0, 300.0, 40)
    residual, inlier = np.sqrt(parallax), np.ones(40)
    inlier[29:] = 0.0
    assert scaled_pairs(view, residual, parallax, inlier) is None
    inlier[29] = 1.0
    assert scaled_pairs(view, residual, parallax, inlier) is not None
    assert scaled_pairs(view, np.zeros(40), parallax, inlier) is None
    assert scaled_pairs(view, residual, np.zeros(40), inlier) is None
    one = rays_only(np.tile([0.0, 0.0, 1.0], (40, 1)), np.tile([0.0, 0.0, 1.0], (40, 1)))
    assert scaled_pairs(one, residual, np.full(40, 3.0), inlier) is None


def test_the_lengths_span_what_there_is():
    assert (
        LONGEST_PARALLAX_LENGTH * 0.5 ** (PARALLAX_LENGTHS - 1)
        < 0.02
        < 1.0
        < LONGEST_PARALLAX_LENGTH
    )
