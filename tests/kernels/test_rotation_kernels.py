"""Rotation of rays: RANSAC, consistent set, likelihood and its derivative."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kernels_kit import View, gradient, packed, shares_of, two_views

from farpoint._kernels import rotation, rotation_residual, rotation_search
from farpoint._kernels.constants import TAIL_RATIO
from farpoint._kernels.pairs import packed_length
from farpoint.geometry import so3, sphere

quick = settings(max_examples=20, deadline=None)
seeds = st.integers(0, 2**32)
# Variance of the core, share of outliers (by the clutter), share of the tail.
MIXTURE = np.array([1.3, 0.1, 0.2])
SHARES = shares_of(MIXTURE[2]).ravel()
CLUTTER, HALF_WIDTH = 0.05, 500.0


class Linearized:
    """Robust cost and normal equations at a rotation."""

    def __init__(self, view: View, prior: np.ndarray, R: np.ndarray) -> None:
        weights = packed(prior)
        self.H, self.g, sums = np.full((3, 3), np.nan), np.full(3, np.nan), np.full(4, np.nan)
        self.cost = rotation.rotation_linearize(
            view.pairs, weights, R, MIXTURE, CLUTTER, self.H, self.g, sums
        )
        self.inlier, self.steps, self.trials, self.squares = sums


def distance2(view: View, R: np.ndarray) -> np.ndarray:
    out = packed(np.full(view.size, np.nan))
    rotation_residual.rotation_distance2(view.pairs, R, out)
    return out[: view.size]


def search(view: View, tolerance: float, seed: int = 0, limit: int = 300) -> np.ndarray:
    R, state = np.full((3, 3), np.nan), np.array([seed], np.uint64)
    rotation_search.search_rotation(view.pairs, view.size, tolerance, limit, state, R)
    return R


def enlarge(view: View, tolerance: float, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    R, consistent = R.copy(), np.empty(view.size, bool)
    count = rotation_search.enlarge_rotation(view.pairs, view.size, tolerance, R, consistent)
    assert count == np.count_nonzero(consistent)
    return R, consistent


def refine(view: View, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    R, mixture, n = R.copy(), np.array([1.0, 0.2, 0.1]), view.size
    weights = packed(np.ones(n))
    given = (view.pairs, weights, n, HALF_WIDTH, 1e-6, 30)
    rotation.refine_rotation(*given, R, mixture, np.empty((3, 3)))
    return R, mixture


def precision(view: View) -> np.ndarray:
    return 2.0 / np.sum(view.noise0**2 + view.noise1**2, axis=(1, 2))


def rotating_view(seed: int, matches: int, *, noise: float, outliers: int = 0) -> View:
    """Rays after a rotation, isotropic noise of 1 mrad times ``noise``; the last are outliers."""
    rng = np.random.default_rng(seed)
    R = so3.exp(rng.normal(size=3) * 0.3)
    rays0 = sphere.normalize(np.c_[rng.uniform(-1, 1, (matches, 2)), np.ones(matches)])
    rays1 = rays0 @ R.T
    rays1[matches - outliers :] = sphere.normalize(rng.normal(size=(outliers, 3)))
    factors = []
    noisy = []
    for rays in (rays0, rays1):
        A = 1e-3 * sphere.tangent_basis(rays)
        shift = noise * np.einsum("nij,nj->ni", A, rng.normal(size=(matches, 2)))
        noisy.append(sphere.normalize(rays + shift))
        factors.append(np.ascontiguousarray(A))
    return View(*noisy, *factors, R, np.array([0.0, 0.0, 1.0]))


def density(distance2: np.ndarray) -> np.ndarray:
    """Density of an inlier, over that of the core at its peak."""
    # In two dimensions a density falls with the square of its sigma.
    parts = (
        np.exp(-0.5 * distance2 / MIXTURE[0] / s**2) / s**2 for s in TAIL_RATIO ** np.arange(4.0)
    )
    return sum(share * part for share, part in zip(SHARES, parts, strict=True))


def plain_distance2(view: View, R: np.ndarray) -> np.ndarray:
    """Mahalanobis distance of ``b - R a`` on the tangent plane of b, matrix by matrix."""
    out = []
    for a, b, A, B in zip(*view[:4], strict=True):
        E = sphere.tangent_basis(b)
        S = E.T @ (B @ B.T + R @ A @ A.T @ R.T) @ E
        z = E.T @ (b - R @ a)
        out.append(z @ np.linalg.solve(S, z))
    return np.array(out)


@quick
@given(seed=seeds)
def test_distances_are_mahalanobis_distances(seed):
    view = two_views(seed, 6, error_rad=0.01)
    np.testing.assert_allclose(distance2(view, view.R), plain_distance2(view, view.R), rtol=1e-8)


def test_distances_of_noise_are_chi_squared_with_two_degrees_of_freedom():
    view = rotating_view(0, 3000, noise=1.0)
    d2 = distance2(view, view.R)
    # Three standard errors: the variance of chi^2 with 2 degrees of freedom is 4.
    assert d2.mean() == pytest.approx(2.0, abs=3 * 2 / math.sqrt(3000))


@quick
@given(seed=seeds)
def test_the_gradient_of_the_robust_cost_with_fixed_noise(seed):
    view = rotating_view(seed, 8, noise=1.0)
    prior = np.random.default_rng(seed).uniform(0.5, 2.0, 8)
    a, b, A, B = view[:4]
    E = sphere.tangent_basis(b)
    S = np.array(
        [e.T @ (y @ y.T + view.R @ x @ x.T @ view.R.T) @ e for e, x, y in zip(E, A, B, strict=True)]
    )

    def cost(dtheta: np.ndarray) -> float:
        z = np.einsum("nij,ni->nj", E, b - a @ (so3.exp(dtheta) @ view.R).T)
        d2 = np.einsum("ni,nij,nj->n", z, np.linalg.inv(S), z)
        return -np.log(prior * density(d2) + CLUTTER).sum()

    at = Linearized(view, prior, view.R)
    numeric = gradient(cost, 3, 1e-6)
    assert at.cost == pytest.approx(cost(np.zeros(3)), rel=1e-9)
    np.testing.assert_allclose(at.g, numeric, rtol=1e-5, atol=1e-6 * np.abs(numeric).max())


@quick
@given(seed=seeds)
def test_the_gradient_is_that_of_the_whole_cost_where_noise_is_isotropic(seed):
    # The noise is rotated, too; for isotropic noise that is of second order.
    view = rotating_view(seed, 8, noise=1.0)

    def cost(dtheta: np.ndarray) -> float:
        return Linearized(view, np.ones(8), so3.exp(dtheta) @ view.R).cost

    numeric = gradient(cost, 3, 1e-6)
    g = Linearized(view, np.ones(8), view.R).g
    np.testing.assert_allclose(g, numeric, rtol=0.0, atol=1e-4 * np.abs(numeric).max())


@quick
@given(seed=seeds)
def test_the_normal_matrix_is_the_information_of_the_matches(seed):
    # Far below the noise every match is an inlier, and the cost is a paraboloid of this curvature.
    view = rotating_view(seed, 12, noise=1e-4)
    at = Linearized(view, np.ones(12), view.R)

    def gradient_at(step: np.ndarray) -> np.ndarray:
        return Linearized(view, np.ones(12), so3.exp(step) @ view.R).g

    # In two dimensions a density falls with the square of its sigma.
    density = SHARES / TAIL_RATIO ** (2 * np.arange(4))
    each = 12 / (density.sum() + CLUTTER)
    assert at.inlier == pytest.approx(each * density.sum(), rel=1e-6)
    assert at.steps == pytest.approx(each * (np.arange(4) @ density), rel=1e-6)
    assert at.trials == pytest.approx(each * ([1, 2, 3, 3] @ density), rel=1e-6)
    h = 1e-6
    numeric = np.array([(gradient_at(h * e) - gradient_at(-h * e)) / (2 * h) for e in np.eye(3)])
    np.testing.assert_allclose(at.H, numeric, rtol=1e-3, atol=1e-3 * at.H.max())


def test_what_a_rotation_makes_of_each_match():
    view = rotating_view(6, 40, noise=1.0, outliers=8)
    distance, inlier = np.full((2, packed_length(40)), np.nan)
    given = (view.pairs, packed(np.ones(40)), HALF_WIDTH, view.R, MIXTURE)
    rotation.evaluate_rotation(*given, distance, inlier)
    variance, outliers, _ = MIXTURE
    expected = plain_distance2(view, view.R)
    np.testing.assert_allclose(distance[:40], expected, rtol=1e-8)
    near = np.minimum(expected, 30720.0 * variance)  # the exponential is constant beyond
    # Outliers fill a disc of this radius, the core is a normal distribution.
    clutter = outliers / (1.0 - outliers) * 2.0 * variance / HALF_WIDTH**2
    np.testing.assert_allclose(
        inlier[:40], density(near) / (density(near) + clutter), rtol=1e-6, atol=1e-9
    )
    assert not inlier[40:].any()


def test_a_match_with_no_prior_counts_for_nothing():
    view = rotating_view(3, 8, noise=1.0, outliers=1)
    prior = np.ones(8)
    prior[-1] = 0.0
    without = View(*(array[:-1] for array in view[:4]), view.R, view.t)
    at, expected = Linearized(view, prior, view.R), Linearized(without, np.ones(7), view.R)
    assert at.cost == pytest.approx(expected.cost)
    np.testing.assert_allclose(at.g, expected.g, rtol=1e-9)
    np.testing.assert_allclose(at.H, expected.H, rtol=1e-9)
    assert at.inlier == pytest.approx(expected.inlier)


@pytest.mark.parametrize("outliers", [0, 10, 24])
def test_the_search_finds_the_rotation_of_the_consistent_rays(outliers):
    view = rotating_view(7, 40, noise=0.3, outliers=outliers)
    R = search(view, 3.0)
    assert so3.angle_between(R, view.R) < 3e-3
    assert so3.angle_between(R, search(view, 3.0)) == 0.0
    enlarged, consistent = enlarge(view, 3.0, R)
    np.testing.assert_array_equal(consistent, np.arange(40) < 40 - outliers)
    assert so3.angle_between(enlarged, view.R) < 5e-4


def test_enlarging_the_set_from_an_inaccurate_start_ends_at_its_own_fit():
    view = rotating_view(2, 40, noise=0.3)
    off = so3.exp(np.array([1.5e-3, -1e-3, 1e-3])) @ view.R
    inside = np.sqrt(plain_distance2(view, off)) < 1.5
    assert 2 < inside.sum() < 30
    R, consistent = enlarge(view, 3.0, off)
    assert consistent.all()
    fit = np.einsum("n,ni,nj->ij", precision(view), view.rays1, view.rays0)
    U, _, Vt = np.linalg.svd(fit)
    np.testing.assert_allclose(R, U @ Vt, rtol=0.0, atol=1e-9)


def test_the_maximum_of_the_likelihood_is_stationary_with_its_noise():
    view = rotating_view(4, 300, noise=0.7, outliers=30)
    R, (variance, outliers, _) = refine(view, search(view, 3.0))
    assert outliers == pytest.approx(0.1, abs=0.02)
    # The standard error of a variance of 540 coordinates is 6 %.
    assert variance == pytest.approx(0.49, rel=0.18)
    # Three standard errors: 0.7 mrad * sqrt(2) in each of 270 matches, over the rays' lever arms.
    assert so3.angle_between(R, view.R) < 3 * 0.7e-3 * math.sqrt(2 * 3 / 270) / 0.5
    again, _ = refine(view, R)
    assert so3.angle_between(again, R) < 1e-7
