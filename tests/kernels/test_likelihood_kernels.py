"""The robust likelihood of a pose: cost, gradient, curvature and maximum."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kernels_kit import View, gradient, moved, two_views

from farpoint._kernels import epipolar, likelihood
from farpoint._kernels.pairs import RayPairs
from farpoint.geometry import so3, sphere

quick = settings(max_examples=25, deadline=None)
seeds = st.integers(0, 2**32)
# Variance of good matches, share of wrong ones (which makes the clutter), share of poor ones.
MIXTURE = np.array([1.3, 0.1, 0.2])
CLUTTER = 0.05


def sampson_jacobian(view: View, i: int) -> tuple[float, np.ndarray]:
    J = np.full(5, np.nan)
    basis = sphere.tangent_basis(view.t)
    residual = epipolar.sampson_jacobian(view.pairs, view.R, view.t, basis, i, J)
    return residual, J


class Linearized:
    """The robust cost at a pose with everything that comes along."""

    def __init__(
        self,
        pairs: RayPairs,
        prior: np.ndarray,
        R: np.ndarray,
        t: np.ndarray,
        mixture: np.ndarray = MIXTURE,
        clutter: float = CLUTTER,
        far_sigma: float = math.inf,
    ) -> None:
        n = len(prior)
        self.H, self.g = np.full((5, 5), np.nan), np.full(5, np.nan)
        self.r, self.w, self.poor = np.full((3, n), np.nan)
        basis = sphere.tangent_basis(t)
        out = (self.H, self.g, self.r, self.w, self.poor)
        self.cost = likelihood.linearize(
            pairs, prior, R, t, basis, mixture, clutter, far_sigma, *out
        )


def hessian_of(view: View, prior: np.ndarray) -> np.ndarray:
    hessian, information = np.full((2, 5, 5), np.nan)
    given = (view.pairs, prior, view.R, view.t, MIXTURE, CLUTTER, math.inf)
    likelihood.curvature(*given, hessian, information)
    at = Linearized(view.pairs, prior, view.R, view.t)
    np.testing.assert_allclose(information, at.H, rtol=1e-9)
    return hessian


class Refined:
    """The maximum of the likelihood from a start, with its mixture."""

    def __init__(self, view: View, step: np.ndarray, spread: float = 500.0) -> None:
        n = len(view.pairs.rays0)
        self.R, self.t = moved(view.R, view.t, step)
        self.mixture, H = np.array([1.0, 0.2, 0.1]), np.empty((5, 5))
        self.r, self.w, self.poor = np.empty((3, n))
        out = (self.mixture, H, self.r, self.w, self.poor)
        given = (view.pairs, np.ones(n), spread, 1e-6, math.inf, 1e-4, 40, self.R, self.t)
        likelihood.refine_pose(*given, *out)
        self.variance, self.wrong, _ = self.mixture


def prior_of(view: View, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.5, 2.0, len(view.pairs.rays0))


@quick
@given(seed=seeds, error_rad=st.sampled_from([1e-3, 1e-2]))
def test_the_gradient_of_the_robust_cost(seed, error_rad):
    view = two_views(seed, 8, error_rad=error_rad)
    prior = prior_of(view, seed)

    def cost(step: np.ndarray) -> float:
        return Linearized(view.pairs, prior, *moved(view.R, view.t, step)).cost

    numeric = gradient(cost, 5, 1e-6)
    g = Linearized(view.pairs, prior, view.R, view.t).g
    np.testing.assert_allclose(g, numeric, rtol=1e-4, atol=1e-5 * np.abs(numeric).max())


@quick
@given(seed=seeds)
def test_cost_weights_and_normal_equations_are_those_of_the_mixture(seed):
    view = two_views(seed, 8, error_rad=2e-3)
    prior = prior_of(view, seed)
    prior[2] = 0.0
    at = Linearized(view.pairs, prior, view.R, view.t)
    used = np.flatnonzero(prior)
    rows = [sampson_jacobian(view, i) for i in used]
    r, J = np.array([row[0] for row in rows]), np.array([row[1] for row in rows])
    good, fair = densities(r)
    right = prior[used] * (good + fair)
    total = right + CLUTTER
    assert at.cost == pytest.approx(-np.log(total).sum())
    np.testing.assert_allclose(at.r[used], r, rtol=1e-12)
    np.testing.assert_allclose(at.w[used], right / total, rtol=1e-9)
    np.testing.assert_allclose(at.poor[used], prior[used] * fair / total, rtol=1e-9)
    assert (at.w[2], at.poor[2]) == (0.0, 0.0)
    # Weights of the normal equations: what makes r w the slope of the cost.
    h = 1e-6
    slope = [sum(densities(r + s * h)) * prior[used] + CLUTTER for s in (1.0, -1.0)]
    w = -(np.log(slope[0]) - np.log(slope[1])) / (2 * h) / r
    np.testing.assert_allclose(at.H, (J.T * w) @ J, rtol=1e-5)
    np.testing.assert_allclose(at.g, J.T @ (w * r), rtol=1e-5, atol=1e-6 * np.abs(at.g).max())


def densities(r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of good and of poor matches, over the peak of a normal density of all being good."""
    variance, _, share = MIXTURE
    sigma = 1.0, likelihood.POOR
    good, fair = (np.exp(-0.5 * r**2 / variance / s**2) / s for s in sigma)
    return (1.0 - share) * good, share * fair


def mirrored(view: View) -> View:
    """The same matches at the opposite direction, from which they all retreat."""
    return view._replace(t=-view.t)


@quick
@given(seed=seeds)
def test_matches_that_retreat_lose_their_density(seed):
    view = two_views(seed, 8, error_rad=5e-4, baseline_m=0.02)
    prior = np.ones(8)
    forward = Linearized(view.pairs, prior, view.R, view.t, far_sigma=3.0)
    backward = Linearized(view.pairs, prior, view.R, -view.t, far_sigma=3.0)
    indifferent = Linearized(view.pairs, prior, view.R, -view.t)
    np.testing.assert_allclose(backward.r, -forward.r, rtol=0.0, atol=1e-9)
    scratch = np.empty(3)
    shifts = [epipolar.parallax(view.pairs, view.R, view.t, i, scratch) for i in range(8)]
    retreat = np.maximum(np.array(shifts) / math.sqrt(MIXTURE[0]) - 3.0, 0.0)
    good, fair = densities(backward.r)
    total = np.exp(-0.5 * retreat**2) * (good + fair) + CLUTTER
    assert backward.cost == pytest.approx(-np.log(total).sum())
    assert indifferent.cost == pytest.approx(-np.log(good + fair + CLUTTER).sum())


@quick
@given(seed=seeds)
def test_the_gradient_by_the_rotation_of_retreating_matches(seed):
    # Little flow, as the derivative takes the noise along the flow for constant.
    view = mirrored(two_views(seed, 8, error_rad=1e-4, baseline_m=0.01, noise_rad=1e-3))
    prior = np.full(8, 50.0)

    def cost(dtheta: np.ndarray) -> float:
        R = so3.exp(dtheta) @ view.R
        return Linearized(view.pairs, prior, R, view.t, far_sigma=0.5).cost

    numeric = gradient(cost, 3, 1e-7)
    at = Linearized(view.pairs, prior, view.R, view.t, far_sigma=0.5)
    flat = Linearized(view.pairs, prior, view.R, view.t)
    assert np.abs(at.g - flat.g).max() > 0.1 * np.abs(at.g).max()
    np.testing.assert_allclose(at.g[:3], numeric, rtol=0.0, atol=0.02 * np.abs(numeric).max())


@settings(max_examples=8, deadline=None)
@given(seed=seeds)
def test_the_exact_hessian_is_the_second_derivative_of_the_robust_cost(seed):
    # Hardly any parallax: there the residual's own curvature is as large as the rest.
    view = two_views(seed, 12, error_rad=1e-3, baseline_m=0.005)
    prior = prior_of(view, seed)
    h = 4e-6

    def cost(step: np.ndarray) -> float:
        return Linearized(view.pairs, prior, *moved(view.R, view.t, step)).cost

    axes = h * np.eye(5)
    numeric = np.array(
        [
            [(cost(a + b) - cost(a - b) - cost(b - a) + cost(-a - b)) / (4 * h * h) for b in axes]
            for a in axes
        ]
    )
    hessian = hessian_of(view, prior)
    np.testing.assert_array_equal(hessian, hessian.T)
    # Each axis in its own unit: the direction knows a thousand times less than the rotation.
    unit = np.sqrt(np.diag(Linearized(view.pairs, prior, view.R, view.t).H))
    scale = np.outer(unit, unit)
    np.testing.assert_allclose(hessian / scale, numeric / scale, rtol=0.0, atol=0.02)


def noisy_views(seed: int, matches: int, wrong: int, poor: int = 0) -> View:
    """Two views with noise of their factors, thrice that for the first, the last anywhere."""
    view = two_views(seed, matches, noise_rad=5e-4)
    rng = np.random.default_rng(seed)
    a, b, A, B = view.pairs
    n = rng.normal(size=(2, matches, 2))
    n[:, :poor] *= likelihood.POOR
    rays0 = sphere.normalize(a + np.einsum("nij,nj->ni", A, n[0]))
    rays1 = sphere.normalize(b + np.einsum("nij,nj->ni", B, n[1]))
    if wrong:
        rays1[-wrong:] = sphere.normalize(np.c_[rng.uniform(-1, 1, (wrong, 2)), np.ones(wrong)])
    return view._replace(pairs=RayPairs(rays0, rays1, A, B))


def test_the_maximum_of_the_likelihood_is_found_from_nearby():
    view = noisy_views(8, 150, wrong=30)
    start = np.array([2e-3, -1e-3, 1e-3, 2e-2, -1e-2])
    at = Refined(view, start)
    # Two starts end in one place.
    other = Refined(view, -0.5 * start)
    assert so3.angle_between(at.R, other.R) < 1e-5
    assert sphere.angle_between(at.t, other.t) < 1e-4
    # Noise of unit size: the standard error of a variance of 115 residuals is 13 %.
    assert at.variance == pytest.approx(1.0, abs=0.4)
    # A wrong match may lie on its epipolar line by chance.
    assert at.wrong == pytest.approx(0.2, abs=0.04)
    assert (at.w[:-30] > 0.5).mean() > 0.97
    assert (at.w[-30:] > 0.5).mean() < 0.15


def test_the_maximum_is_stationary_under_its_own_mixture():
    view = noisy_views(9, 60, wrong=6, poor=15)
    at = Refined(view, np.zeros(5))
    clutter = likelihood.clutter_density(at.variance, at.wrong, 500.0)

    def cost(step: np.ndarray) -> float:
        R, t = moved(at.R, at.t, step)
        return Linearized(view.pairs, np.ones(60), R, t, at.mixture, clutter).cost

    # And so is the mixture: the variance of good matches is that of the weighted residuals.
    weight = at.w - at.poor + at.poor / likelihood.POOR**2
    variance = np.sum(weight * at.r**2) / (at.w.sum() - 5.0)
    assert at.variance == pytest.approx(variance, rel=0.01)
    assert at.wrong == pytest.approx(1.0 - at.w.mean(), abs=0.01)
    lowest = cost(np.zeros(5))
    for axis in np.eye(5):
        for sign in (-1.0, 1.0):
            assert cost(sign * 1e-3 * axis) > lowest
