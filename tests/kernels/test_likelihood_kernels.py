"""Robust likelihood of a pose: cost, gradient, information and maximum."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from kernels_kit import (
    View,
    gradient,
    half_width_of,
    matches_of,
    moved,
    packed,
    pose_of,
    shaken,
    shares_of,
    two_views,
)
from scipy.stats import norm

from farpoint._kernels import epipolar, likelihood, refinement
from farpoint._kernels.compile import kernel
from farpoint._kernels.constants import (
    CHEIRALITY_SIGMA,
    CHEIRALITY_WEIGHT,
    LONG_TAIL,
    PRIOR_SHARE,
    PRIOR_WEIGHT,
    REPEATED_WIDTH_RATIO,
    SHORT_TAIL,
    TAIL_RATIO,
)
from farpoint._kernels.information import information
from farpoint._kernels.pairs import address
from farpoint._kernels.pose import LinearisationPoint
from farpoint._kernels.vectors import matrix, tangent_columns, vector
from farpoint.geometry import so3, sphere

quick = settings(max_examples=25, deadline=None)
seeds = st.integers(0, 2**32)
# Variance of the core; shares of outliers, of the tail and of repeated structure.
MIXTURE = np.array([1.3, 0.1, 0.2, 0.0])
CLUTTER = 0.05


@kernel
def derivatives_of(pairs: np.ndarray, i: int, R: np.ndarray, t: np.ndarray) -> tuple:
    direction = vector(t)
    return epipolar.sampson_jacobian(
        pairs, address(i), matrix(R), direction, tangent_columns(direction)
    )


def sampson_jacobian(view: View, i: int) -> tuple[float, np.ndarray]:
    *J, residual = derivatives_of(view.pairs, i, view.R, view.t)
    return residual, np.array(J)


def point_of(
    view: View,
    prior: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    mixture=MIXTURE,
    half_width: float = half_width_of(MIXTURE, CLUTTER),
    tail: float = LONG_TAIL,
) -> LinearisationPoint:
    return LinearisationPoint(view.pairs, packed(prior), R, t, mixture, half_width, tail)


class Linearized:
    """Robust cost and normal equations at a pose, as of `point_of`."""

    def __init__(self, *point: Any, soft_cheirality: bool = False, **computed: Any) -> None:
        normal, shares = np.full((6, 6), np.nan), np.full(4, np.nan)
        self.cost = likelihood.linearize(
            point_of(*point, **computed), soft_cheirality, normal, shares
        )
        np.testing.assert_array_equal(normal, normal.T)
        self.H, self.g, self.squares = normal[:5, :5], normal[:5, 5], normal[5, 5]
        self.inlier, self.steps, self.trials, self.repeated = shares


class Evaluated:
    """Residual, parallax and inlier probability at a pose, as of `point_of`."""

    def __init__(self, view: View, *point: Any, **computed: Any) -> None:
        out = np.full((3, len(packed(np.zeros(view.size)))), np.nan)
        likelihood.evaluate_residuals(point_of(view, *point, **computed), *out)
        assert np.isfinite(out).all()
        self.r, self.parallax, self.inlier = out[:, : view.size]


class Refined:
    """Maximum of the likelihood from a start, with its mixture."""

    def __init__(self, view: View, step: np.ndarray, half_width: float = 500.0) -> None:
        pose = pose_of(*moved(view.R, view.t, step), np.array([1.0, 0.2, 0.1, 0.1]))
        refinement.refine_pose(matches_of(view, half_width, soft_cheirality=True), 1e-6, 40, pose)
        self.R, self.t, self.mixture, *_ = pose
        self.variance, self.outlier_share, self.tail_share, self.repeated = self.mixture
        self.half_width = half_width


def prior_of(view: View, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.5, 2.0, view.size)


@quick
@given(seed=seeds, error_rad=st.sampled_from([1e-3, 1e-2]))
def test_the_gradient_of_the_robust_cost(seed, error_rad):
    view = two_views(seed, 8, error_rad=error_rad)
    prior = prior_of(view, seed)

    def cost(step: np.ndarray) -> float:
        return Linearized(view, prior, *moved(view.R, view.t, step)).cost

    # The cost is exact to 1e-8, and differences of it over the step.
    numeric = gradient(cost, 5, 1e-5)
    g = Linearized(view, prior, view.R, view.t).g
    np.testing.assert_allclose(g, numeric, rtol=1e-3, atol=2e-4 * np.abs(numeric).max() + 1e-2)


@quick
@given(
    seed=seeds,
    repeated=st.sampled_from([0.0, 0.4]),
    tail=st.sampled_from([LONG_TAIL, SHORT_TAIL]),
)
def test_cost_weights_and_normal_equations_are_those_of_the_mixture(seed, repeated, tail):
    view = two_views(seed, 8, error_rad=2e-3)
    prior = prior_of(view, seed)
    prior[2] = 0.0
    with_repeated = np.array([*MIXTURE[:3], repeated])
    at = Linearized(view, prior, view.R, view.t, with_repeated, tail=tail)
    rows = [sampson_jacobian(view, i) for i in range(8)]
    r, J = np.array([row[0] for row in rows]), np.array([row[1] for row in rows])
    each = prior * densities(r, tail)
    # A Cauchy density, over the uniform density of outliers.
    half = half_width_of(MIXTURE, CLUTTER) / REPEATED_WIDTH_RATIO
    uniform = 0.5 / half_width_of(MIXTURE, CLUTTER)
    near = CLUTTER * repeated / (np.pi * half * (1.0 + (r / half) ** 2)) / uniform
    lost = CLUTTER * (1.0 - repeated) + near
    inlier, total = each.sum(axis=0), each.sum(axis=0) + lost
    assert at.cost == pytest.approx(-np.log(total[prior > 0]).sum(), abs=1e-6)
    assert at.inlier == pytest.approx(np.sum(inlier / total))
    assert at.steps == pytest.approx(np.sum(np.arange(4.0) @ each / total))
    assert at.trials == pytest.approx(np.sum([1.0, 2.0, 2.0 + tail, 3.0] @ each / total))
    assert at.repeated == pytest.approx(np.sum((near / total)[prior > 0]))
    # Weights of the normal equations: r w is the slope of the cost; outliers have no weight.
    h = 1e-6
    slope = [prior * densities(r + s * h, tail).sum(axis=0) + lost for s in (1.0, -1.0)]
    w = -(np.log(slope[0]) - np.log(slope[1])) / (2 * h) / r
    np.testing.assert_allclose(at.H, (J.T * w) @ J, rtol=1e-5, atol=1e-9 * at.H.max())
    np.testing.assert_allclose(at.g, J.T @ (w * r), rtol=1e-5, atol=1e-6 * np.abs(at.g).max())
    assert at.squares == pytest.approx(np.sum(w * r**2), rel=1e-5)
    evaluated = Evaluated(view, prior, view.R, view.t, with_repeated, tail=tail)
    np.testing.assert_allclose(evaluated.r, r, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(evaluated.inlier, inlier / total, rtol=1e-8)


def densities(r: np.ndarray, tail: float = LONG_TAIL) -> np.ndarray:
    """Densities of core and tail, over the peak of a normal density of the core."""
    variance, _, tail_share, _ = MIXTURE
    sigma = TAIL_RATIO ** np.arange(4.0)[:, None]
    return shares_of(tail_share, tail) * np.exp(-0.5 * r**2 / variance / sigma**2) / sigma


@quick
@given(seed=seeds, baseline_m=st.sampled_from([1e-3, 1e-2]))
def test_parallax_is_the_shift_towards_the_direction_over_its_sigma(seed, baseline_m):
    view = two_views(seed, 3, baseline_m=baseline_m)
    shifts = Evaluated(view, np.ones(3), view.R, view.t).parallax
    for i in range(3):
        a, b, A, B = (array[i] for array in view[:4])
        m = view.R @ a
        along = sphere.normalize(view.t - (view.t @ m) * m)
        sigma = np.hypot(np.linalg.norm((view.R @ A).T @ along), np.linalg.norm(B.T @ along))
        assert shifts[i] == pytest.approx((b - m) @ along / sigma, rel=1e-6)
        assert shifts[i] > 0.0


@quick
@given(seed=seeds)
def test_backward_flow_lowers_the_density(seed):
    view = two_views(seed, 8, error_rad=5e-4, baseline_m=0.04)
    prior = np.ones(8)
    forward = Evaluated(view, prior, view.R, view.t)
    backward = Evaluated(view, prior, view.R, -view.t)
    np.testing.assert_allclose(backward.r, -forward.r, rtol=0.0, atol=1e-9)
    shift = backward.parallax / np.sqrt(MIXTURE[0])
    penalty = CHEIRALITY_WEIGHT * np.minimum(shift + CHEIRALITY_SIGMA, 0.0) ** 2
    assume(penalty.max() > 1.0)
    density = densities(backward.r) * np.exp(-0.5 * penalty / 8.0 ** np.arange(4.0)[:, None])
    at = Linearized(view, prior, view.R, -view.t)
    assert at.cost == pytest.approx(-np.log(density.sum(axis=0) + CLUTTER).sum(), rel=1e-3)
    assert at.cost > Linearized(view, prior, view.R, view.t).cost


def test_the_cheirality_limit_is_exceeded_by_one_of_160():
    """Up to the limit, which one of 160 exceeds, no penalty; at 8.5 sigma that of the noise."""
    assert norm.sf(CHEIRALITY_SIGMA) == pytest.approx(1.0 / 160.0, rel=0.02)
    beyond = 8.5 - CHEIRALITY_SIGMA
    assert CHEIRALITY_WEIGHT * beyond**2 == pytest.approx(8.5**2, rel=0.02)


@quick
@given(seed=seeds)
def test_with_soft_cheirality_penalties_are_residuals(seed):
    view = two_views(seed, 8, error_rad=5e-4, baseline_m=0.04)
    prior, normal = prior_of(view, seed), np.array([1.3, 0.1, 1e-9, 0.0])

    def at(step: np.ndarray, soft_cheirality: bool) -> Linearized:
        pose = moved(view.R, -view.t, step)
        return Linearized(view, prior, *pose, mixture=normal, soft_cheirality=soft_cheirality)

    here, held = at(np.zeros(5), True), at(np.zeros(5), False)
    # Small penalties are no residuals.
    assume(here.squares > held.squares)
    numeric = gradient(lambda step: at(step, True).cost, 5, 1e-6)
    # The variance of a parallax is taken as constant.
    np.testing.assert_allclose(here.g, numeric, rtol=0.0, atol=0.06 * np.abs(numeric).max() + 0.5)
    assert here.cost == held.cost
    # The added matrix is positive semi-definite.
    more = np.linalg.eigvalsh(here.H - held.H)
    assert more.min() > -1e-6 * more.max()


def test_with_a_heavy_tail_penalties_have_less_weight():
    view = two_views(4, 40, error_rad=5e-4, baseline_m=0.04)
    ones = np.ones(40)

    def drawn(t: np.ndarray, tail_share: float) -> np.ndarray:
        computed = np.array([1.3, 0.1, tail_share, 0.0])
        given = [
            Linearized(view, ones, view.R, t, mixture=computed, soft_cheirality=soft_cheirality).H
            for soft_cheirality in (True, False)
        ]
        return given[0] - given[1]

    plain, tailed = np.trace(drawn(-view.t, 1e-9)), np.trace(drawn(-view.t, 0.4))
    assert plain > 0.0
    assert 0.0 < tailed < 0.36 * plain


def test_the_maximum_of_the_likelihood_is_found_from_nearby():
    view = noisy_views(8, 150, outliers=30)
    start = np.array([2e-3, -1e-3, 1e-3, 2e-2, -1e-2])
    at = Refined(view, start)
    # Two starts converge to one pose.
    other = Refined(view, -0.5 * start)
    assert so3.angle_between(at.R, other.R) < 1e-5
    assert sphere.angle_between(at.t, other.t) < 1e-4
    # Noise of unit size: the standard error of a variance of 115 residuals is 13 %.
    assert at.variance == pytest.approx(1.0, abs=0.4)
    # An outlier may lie on its epipolar line by chance.
    assert at.outlier_share == pytest.approx(0.2, abs=0.04)
    inlier = Evaluated(view, np.ones(150), at.R, at.t).inlier
    assert (inlier[:-30] > 0.5).mean() > 0.97
    assert (inlier[-30:] > 0.5).mean() < 0.15


def noisy_views(seed: int, matches: int, outliers: int, in_tail: int = 0) -> View:
    """Two views with noise; the first ``in_tail`` matches in the tail, the last outliers."""
    rng = np.random.default_rng(seed)
    sigma = np.where(np.arange(matches) < in_tail, TAIL_RATIO, 1.0)
    view = shaken(two_views(seed, matches, noise_rad=5e-4), seed, sigma)
    if outliers:
        view.rays1[-outliers:] = sphere.normalize(
            np.c_[rng.uniform(-1, 1, (outliers, 2)), np.ones(outliers)]
        )
    return view


def test_the_maximum_is_stationary_under_its_own_mixture():
    view = noisy_views(9, 60, outliers=6, in_tail=15)
    at = Refined(view, np.zeros(5))

    def cost(step: np.ndarray) -> float:
        R, t = moved(at.R, at.t, step)
        return Linearized(view, np.ones(60), R, t, at.mixture, at.half_width).cost

    # So is the mixture: the variance of the core is that of the weighted residuals.
    end = Linearized(view, np.ones(60), at.R, at.t, at.mixture, at.half_width)
    assert at.variance == pytest.approx(end.squares * at.variance / (end.inlier - 5.0), rel=0.01)
    assert at.outlier_share == pytest.approx(1.0 - end.inlier / 60, abs=0.01)
    # With the Beta prior of both shares.
    of_all = end.trials + PRIOR_WEIGHT
    share = (end.steps + PRIOR_SHARE * PRIOR_WEIGHT) / of_all
    assert at.tail_share == pytest.approx(share, abs=0.01)
    outlier_share = 60 - end.inlier + PRIOR_WEIGHT
    share = (end.repeated + PRIOR_SHARE * PRIOR_WEIGHT) / outlier_share
    assert at.repeated == pytest.approx(share, abs=0.01)
    lowest = cost(np.zeros(5))
    for axis in np.eye(5):
        for sign in (-1.0, 1.0):
            assert cost(sign * 1e-3 * axis) > lowest


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="takes minutes")
def test_few_steps_come_near_the_maximum_where_tails_are_heavy():
    # Plain EM ends 2.3 above the minimum on average, in log likelihood.
    short = []
    for seed in range(24):
        rng = np.random.default_rng(seed)
        view = shaken(two_views(seed, 300, noise_rad=5e-4), seed, rng.chisquare(1.0, 300) ** -0.5)
        view.rays1[-100:] = sphere.normalize(np.c_[rng.uniform(-1, 1, (100, 2)), np.ones(100)])

        matches = matches_of(view, 500.0, soft_cheirality=True)

        def refined(
            start: float, precision: float, times: int, view=view, matches=matches
        ) -> float:
            pose = pose_of(view.R, view.t, np.array([start, 0.2, 0.1, 0.1]))
            for _ in range(times):
                refinement.refine_pose(matches, precision, 20, pose)
            return pose.cost[0]

        short.append(refined(30.0, 1e-3, 1) - refined(2.0, 1e-12, 60))
    assert np.mean(short) < 1.6


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="takes minutes")
def test_repeated_refinement_stays_at_the_maximum():
    ranges = []
    for seed in range(80):
        rng, n, outlier_share = np.random.default_rng(seed), *((300, 100), (60, 10))[seed % 2]
        view = two_views(seed, n, noise_rad=5e-4, baseline_m=0.1)
        view = shaken(view, seed, rng.chisquare(1.0, n) ** -0.5)
        anywhere = np.c_[rng.uniform(-1, 1, (outlier_share, 2)), np.ones(outlier_share)]
        view.rays1[-outlier_share:] = sphere.normalize(anywhere)
        pose, costs = pose_of(view.R, view.t, np.array([0.01, 0.2, 0.1, 0.1])), []
        for _ in range(6):
            refinement.refine_pose(matches_of(view, 500.0, soft_cheirality=True), 1e-3, 20, pose)
            costs.append(pose.cost[0])
        ranges.append(max(costs) - min(costs))
    # 0.76; 0.91 if the Beta prior is left out of the cost.
    assert np.mean(ranges) < 0.83


@pytest.mark.parametrize(("most", "least"), [(0.2, 0.2), (4.0, 0.7**2 * (0.8 + 0.2 * 16.0))])
def test_the_noise_variance_is_at_most_its_upper_bound(most, least):
    view = two_views(5, 200, noise_rad=5e-4)
    # Sigma 0.7 in both images, and 4 times as much for 20 % of the matches.
    view = shaken(view, 5, 0.7 * np.where(np.arange(200) % 5, 1.0, 4.0))
    pose = pose_of(view.R, view.t, np.array([1.0, 0.2, 0.1, 0.1]))
    given = matches_of(view, 500.0, soft_cheirality=True)._replace(max_variance=most)
    refinement.refine_pose(given, 1e-3, 20, pose)
    variance, outlier_share, tail_share, _ = pose.mixture
    assert variance == pytest.approx(least, rel=0.05)
    assert tail_share < 1e-6
    assert outlier_share < 0.25
    assert 1e-6 < so3.angle_between(pose.R, view.R) < 1e-3


def informed(
    pairs: np.ndarray, prior: np.ndarray, view: View, mixture: np.ndarray, clutter: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gauss-Newton matrix, the part of it that is noise, and the scatter of the gradient."""
    normal, noise, scatter = np.empty((6, 6)), np.empty((5, 5)), np.empty((5, 5))
    point = LinearisationPoint(
        pairs, prior, view.R, view.t, mixture, half_width_of(mixture, clutter), LONG_TAIL
    )
    information(point, False, normal, noise, scatter)
    return normal[:5, :5], noise, scatter


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="takes half a minute")
def test_the_share_of_noise_in_the_information():
    """The Jacobian is proportional to the flow: noise along the line counts as information."""
    clean = two_views(3, 40, noise_rad=1e-3, baseline_m=0.02)
    trials = 1500
    whole, noise = np.zeros((2, 5, 5))
    mixture, weights = np.array([1.0, 0.1, 0.0, 0.0]), packed(np.ones(40))
    for trial in range(trials):
        pairs = shaken(clean, trial).pairs
        one, of_noise, _ = informed(pairs, weights, clean, mixture, 1e-12)
        whole, noise = whole + one / trials, noise + of_noise / trials
    exact, *_ = informed(clean.pairs, weights, clean, mixture, 1e-12)
    unit = np.sqrt(np.diag(exact))
    scale = np.outer(unit, unit)
    # The mean addition by noise is the noise share computed, and not small.
    assert np.linalg.norm(noise / scale) > 0.1
    np.testing.assert_allclose((whole - noise) / scale, exact / scale, rtol=0.0, atol=0.02)


def test_a_match_at_the_epipole_gives_no_information():
    view = two_views(3, 12)
    near = sphere.normalize(view.R.T @ view.t + 1e-5)
    view.rays0[0], view.rays1[0] = near, sphere.normalize(view.R @ near)
    computed = informed(view.pairs, packed(np.ones(12)), view, MIXTURE, CLUTTER)
    rest = View(*(array[1:] for array in view[:4]), view.R, view.t)
    others = informed(rest.pairs, packed(np.ones(11)), rest, MIXTURE, CLUTTER)
    for all_of_them, without in zip(computed, others, strict=True):
        np.testing.assert_allclose(
            all_of_them, without, rtol=1e-9, atol=1e-12 * np.abs(without).max()
        )
    assert all(np.isfinite(part).all() for part in computed)
