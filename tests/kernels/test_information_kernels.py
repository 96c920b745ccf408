"""Information of the matches, against the likelihood and against sampled noise."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from kernels_kit import View, half_width_of, packed, shares_of, two_views

from farpoint._kernels import epipolar, likelihood
from farpoint._kernels.compile import kernel
from farpoint._kernels.constants import LONG_TAIL
from farpoint._kernels.information import information
from farpoint._kernels.pairs import address
from farpoint._kernels.pose import LinearisationPoint
from farpoint._kernels.vectors import matrix, tangent_columns, vector
from farpoint.geometry import so3, sphere

VARIANCE, TAIL_RATIO, CLUTTER = 1.3, 0.2, 0.05
MIXTURE = np.array([VARIANCE, 0.1, TAIL_RATIO, 0.0])


@kernel
def jacobian_of(pairs: np.ndarray, i: int, R: np.ndarray, t: np.ndarray) -> tuple:
    """Residual and its derivatives; variances of the constraint and of the flow."""
    at, rotation, direction = address(i), matrix(R), vector(t)
    return (
        epipolar.sampson_jacobian(pairs, at, rotation, direction, tangent_columns(direction)),
        epipolar.variances(pairs, at, rotation, direction),
    )


class Informed(NamedTuple):
    known: float
    effective: float
    normal: np.ndarray
    noise: np.ndarray
    scatter: np.ndarray

    @property
    def whole(self) -> np.ndarray:
        return self.normal[:5, :5]


def informed(view: View, prior: np.ndarray, shrunk_flow: bool = False) -> Informed:
    computed = np.full((6, 6), np.nan), *np.full((2, 5, 5), np.nan)
    point = LinearisationPoint(
        view.pairs,
        packed(prior),
        view.R,
        view.t,
        MIXTURE,
        half_width_of(MIXTURE, CLUTTER),
        LONG_TAIL,
    )
    return Informed(*information(point, shrunk_flow, *computed), *computed)


def parts(view: View, prior: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residuals over sigma; mean weight and mean squared weight over the components.

    The variance of each component of the tail is 8 times that of the one before.
    """
    r = np.array([jacobian_of(view.pairs, i, view.R, view.t)[0][5] for i in range(view.size)])
    z = r / np.sqrt(VARIANCE)
    variance = 8.0 ** np.arange(4.0)[:, None]
    shares = shares_of(TAIL_RATIO)
    density = prior * shares * np.exp(-0.5 * z * z / variance) / np.sqrt(variance)
    chance = density / (density.sum(axis=0) + CLUTTER)
    return z, np.sum(chance / variance, axis=0), np.sum(chance / variance**2, axis=0)


def jacobians(view: View) -> np.ndarray:
    """Jacobian (N, 5) of all residuals, with the residuals in the last column."""
    return np.array([jacobian_of(view.pairs, i, view.R, view.t)[0] for i in range(view.size)])


def leverages(J: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Leverage of each match."""
    inverse = np.linalg.inv((weight[:, None] * J).T @ J)
    return weight * np.einsum("ni,ij,nj->n", J, inverse, J)


def scattered(J: np.ndarray, weight: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Observed variance of the gradient, by the residuals ``z`` over sigma."""
    leverage = leverages(J, weight)
    taken = (1.0 - leverage**3) / (1.0 - np.minimum(leverage, 0.9))
    score = weight * z * np.sqrt(VARIANCE) * np.sqrt(taken)
    return (score[:, None] * J).T @ (score[:, None] * J)


def test_a_match_of_small_leverage_has_its_gauss_newton_weight():
    view = two_views(3, 400, error_rad=2e-3)
    prior = np.random.default_rng(3).uniform(0.5, 2.0, 400)
    normal = np.empty((6, 6))
    likelihood.linearize(
        LinearisationPoint(
            view.pairs,
            packed(prior),
            view.R,
            view.t,
            MIXTURE,
            half_width_of(MIXTURE, CLUTTER),
            LONG_TAIL,
        ),
        False,
        normal,
        np.empty(4),
    )
    scale = np.sqrt(normal.diagonal())
    away = (informed(view, prior).normal - normal) / np.outer(scale, scale)
    assert 1e-6 < np.abs(away).max() < 1e-3


def test_a_match_of_leverage_one_has_hardly_any_weight():
    # Ten matches of one pose, all but one with little flow: that match dominates one axis.
    near = two_views(3, 10, error_rad=2e-3)
    far = two_views(3, 10, error_rad=2e-3, depth_m=(200.0, 400.0))
    view = near._replace(rays1=np.vstack([near.rays1[:1], far.rays1[1:]]))
    weight = parts(view, np.ones(10))[1] / VARIANCE
    J = jacobians(view)
    leverage = leverages(J[:, :5], weight)
    assert leverage[0] > 0.9
    kept = weight * (1.0 - leverage**3)
    expected = (kept[:, None] * J).T @ J
    found = informed(view, np.ones(10))
    atol = 1e-9 * np.abs(expected).max()
    np.testing.assert_allclose(found.normal, expected, rtol=1e-6, atol=atol)
    # Five axes of one match each: five effective matches of equal leverage.
    assert found.effective == pytest.approx(25.0 / np.sum(leverage**2), rel=1e-6)
    assert found.effective < 8.5


def test_every_match_twice_doubles_the_effective_number():
    view = two_views(3, 60, error_rad=2e-3)
    twice = View(*(np.concatenate((each, each)) for each in view[:4]), view.R, view.t)
    effective = informed(view, np.ones(60)).effective
    assert 5.0 < effective < 60.0
    assert informed(twice, np.ones(120)).effective == pytest.approx(2.0 * effective, rel=1e-9)


def test_unknown_components_cost_the_variance_of_the_score():
    view = two_views(4, 40, error_rad=2e-3)
    prior = np.random.default_rng(4).uniform(0.5, 2.0, 40)
    z, weight, square = parts(view, prior)
    expected = 1.0 - np.sum(z * z * (square - weight * weight)) / np.sum(weight)
    assert expected < 0.9  # else nothing is tested
    assert informed(view, prior).known == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("matches", [7, 40])
def test_the_scatter_is_that_of_a_fit_which_each_match_has_drawn_to_itself(matches):
    view = two_views(5, matches, error_rad=2e-3)
    prior = np.random.default_rng(5).uniform(0.5, 2.0, matches)
    z, weight, _ = parts(view, prior)
    J, weight = jacobians(view)[:, :5], weight / VARIANCE
    assert leverages(J, weight).max() > 2.0 / matches  # else nothing is tested
    expected = scattered(J, weight, z)
    scatter = informed(view, prior).scatter
    np.testing.assert_allclose(scatter, expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())


def test_a_single_match_scatters_as_it_is_off():
    # It fixes no pose, and has no leverage.
    view = two_views(6, 1, error_rad=2e-3)
    z, weight, _ = parts(view, np.ones(1))
    *J, _ = jacobian_of(view.pairs, 0, view.R, view.t)[0]
    score = weight * z / np.sqrt(VARIANCE)
    expected = score**2 * np.outer(J, J)
    np.testing.assert_allclose(informed(view, np.ones(1)).scatter, expected, rtol=1e-6)


def test_no_match_at_all_lacks_nothing():
    assert informed(two_views(4, 3), np.zeros(3)).known == 1.0


@pytest.mark.parametrize("seed", range(4))
def test_noise_along_the_line_changes_the_jacobian_as_computed(seed):
    view = two_views(seed, 1, baseline_m=1e-3)
    m = view.R @ view.rays0[0]
    axis = sphere.normalize(np.cross(m, view.t))

    def jacobian(angle_rad: float) -> np.ndarray:
        """Derivative of the constraint by a shift of the later ray along its epipolar line."""
        at = view._replace(rays1=view.rays1 @ so3.exp(angle_rad * axis).T)
        (*J, _), (g, _) = jacobian_of(at.pairs, 0, at.R, at.t)
        return np.sqrt(g) * np.array(J)

    change = (jacobian(1e-5) - jacobian(-1e-5)) / 2e-5
    _, weight, _ = parts(view, np.ones(1))
    _, (g, flow) = jacobian_of(view.pairs, 0, view.R, view.t)
    variance = flow / np.sum(np.cross(m, view.t) ** 2)  # of the angle, for unit noise
    expected = weight * variance / g * np.outer(change, change)
    noise = informed(view, np.ones(1)).noise
    np.testing.assert_allclose(noise, expected, rtol=0.0, atol=3e-3 * np.abs(expected).max())


class Rows(NamedTuple):
    """Per match (N,): inverse depth, its variance, Jacobian, derivative of that by the depth."""

    depth: np.ndarray
    depth_variance: np.ndarray
    jacobian: np.ndarray
    change: np.ndarray


def rows(view: View) -> Rows:
    depth, depth_variance, jacobian, changes = [], [], [], []
    for i in range(view.size):
        (*J, _), (g, flow_variance) = jacobian_of(view.pairs, i, view.R, view.t)
        m, b = view.R @ view.rays0[i], view.rays1[i]
        along = view.t - (m @ view.t) * m
        square = along @ along
        depth.append(along @ b / square)
        depth_variance.append(VARIANCE * flow_variance / square**2)
        across = np.cross(m, view.t)
        basis = np.stack(tangent_columns(view.t))
        changes.append(np.r_[(m @ view.t) * along, basis @ across] / np.sqrt(g))
        jacobian.append(J)
    return Rows(*map(np.array, (depth, depth_variance, jacobian, changes)))


def prediction(computed: Rows, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """BLUP of each inverse depth, and the weight of the measured depth in it.

    Mean and variance of all depths are the fixed point of the method of moments.
    """
    mean, variance = (
        0.0,
        np.sum(weight / computed.depth_variance * computed.depth**2)
        / np.sum(weight / computed.depth_variance),
    )
    for _ in range(500):
        w = weight / (variance + computed.depth_variance)
        mean = np.sum(w * computed.depth) / np.sum(w)
        w = w / (variance + computed.depth_variance)
        variance = max(
            np.sum(w * ((computed.depth - mean) ** 2 - computed.depth_variance)) / np.sum(w), 0.0
        )
    own = variance / (variance + computed.depth_variance)
    return mean + own * (computed.depth - mean), own


@pytest.mark.parametrize("baseline_m", [0.3, 0.05, 0.02])
def test_the_flow_is_predicted_from_that_of_all(baseline_m):
    view = two_views(3, 60, baseline_m=baseline_m, error_rad=1e-3, noise_rad=2e-3)
    prior = np.random.default_rng(3).uniform(0.5, 2.0, 60)
    z, weight, _ = parts(view, prior)
    computed = rows(view)
    expected, own = prediction(computed, weight)
    J = computed.jacobian + (expected - computed.depth)[:, None] * computed.change
    weight = weight / VARIANCE
    weight = weight * (1.0 - leverages(J, weight) ** 3)
    found = informed(view, prior, shrunk_flow=True)
    scale = np.abs((weight[:, None] * J).T @ J).max()
    np.testing.assert_allclose(
        found.normal[:5, :5], (weight[:, None] * J).T @ J, rtol=1e-3, atol=1e-5 * scale
    )
    gradient = J.T @ (weight * z * np.sqrt(VARIANCE))
    np.testing.assert_allclose(
        found.normal[:5, 5], gradient, rtol=1e-3, atol=1e-4 * np.abs(gradient).max()
    )
    noise = (computed.change.T * (weight * own**2 * computed.depth_variance)) @ computed.change
    np.testing.assert_allclose(found.noise, noise, rtol=2e-2, atol=1e-3 * np.abs(noise).max())
    assert found.known == informed(view, prior).known


def test_long_flow_is_not_shrunk():
    view = two_views(3, 60, baseline_m=0.5, noise_rad=1e-5)
    measured, guessed = informed(view, np.ones(60)), informed(view, np.ones(60), shrunk_flow=True)
    np.testing.assert_allclose(guessed.normal[:5, :5], measured.whole, rtol=1e-3)
    np.testing.assert_allclose(guessed.noise, measured.noise, rtol=1e-2, atol=1e-12)
    np.testing.assert_allclose(guessed.scatter, measured.scatter, rtol=1e-3, atol=1e-12)


def test_the_scatter_of_predicted_flow_is_that_of_its_jacobian():
    view = two_views(5, 40, baseline_m=0.1, error_rad=2e-3, noise_rad=2e-3)
    z, weight, _ = parts(view, np.ones(40))
    computed = rows(view)
    J = (
        computed.jacobian
        + (prediction(computed, weight)[0] - computed.depth)[:, None] * computed.change
    )
    expected = scattered(J, weight / VARIANCE, z)
    scatter = informed(view, np.ones(40), shrunk_flow=True).scatter
    np.testing.assert_allclose(scatter, expected, rtol=1e-3, atol=1e-4 * np.abs(expected).max())


def test_nothing_is_predicted_from_no_match():
    normal = informed(two_views(4, 3), np.zeros(3), shrunk_flow=True).normal
    np.testing.assert_array_equal(normal, np.zeros((6, 6)))
