"""The Sampson residual and its full derivatives against differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kernels_kit import View, gradient, moved, two_views

from farpoint._kernels import epipolar
from farpoint._kernels.pairs import RayPairs
from farpoint.geometry import so3, sphere

quick = settings(max_examples=25, deadline=None)
seeds = st.integers(0, 2**32)


def sampson(pairs: RayPairs, R: np.ndarray, t: np.ndarray, i: int) -> float:
    return epipolar.sampson(pairs, R, t, i)


def sampson_jacobian(view: View, i: int) -> tuple[float, np.ndarray]:
    J = np.full(5, np.nan)
    basis = sphere.tangent_basis(view.t)
    residual = epipolar.sampson_jacobian(view.pairs, view.R, view.t, basis, i, J)
    return residual, J


def sampson_curvature(view: View, i: int) -> tuple[float, np.ndarray, np.ndarray]:
    scratch, J, K = np.full((6, 5), np.nan), np.full(5, np.nan), np.full((5, 5), np.nan)
    basis = sphere.tangent_basis(view.t)
    residual = epipolar.sampson_curvature(view.pairs, view.R, view.t, basis, i, scratch, J, K)
    return residual, J, K


@quick
@given(seed=seeds, error_rad=st.sampled_from([0.0, 1e-3, 0.3]))
def test_the_residual_is_the_constraint_over_its_own_sigma(seed, error_rad):
    view = two_views(seed, 3, error_rad=error_rad)
    a, b, A, B = (array[0] for array in view.pairs)

    def constraint(n: np.ndarray) -> float:
        return (b + B @ n[2:]) @ np.cross(view.t, view.R @ (a + A @ n[:2]))

    # The constraint is linear in each of the four coordinates of noise: differences are exact.
    sigma = np.linalg.norm(gradient(constraint, 4, 1.0))
    residual = sampson(view.pairs, view.R, view.t, 0)
    assert residual == pytest.approx(constraint(np.zeros(4)) / sigma, rel=1e-9, abs=1e-9)
    if error_rad == 0.0:
        assert residual == pytest.approx(0.0, abs=1e-9)


def test_the_residual_of_noise_is_distributed_as_one_coordinate_of_it():
    view = two_views(5, 4000, noise_rad=1e-4)
    rng = np.random.default_rng(6)
    a, b, A, B = view.pairs
    n = rng.normal(size=(2, len(a), 2))
    noisy = RayPairs(
        sphere.normalize(a + np.einsum("nij,nj->ni", A, n[0])),
        sphere.normalize(b + np.einsum("nij,nj->ni", B, n[1])),
        A,
        B,
    )
    residual = [sampson(noisy, view.R, view.t, i) for i in range(len(a))]
    # Three standard errors of a standard deviation from 4000 samples are 3.4 %.
    assert np.std(residual) == pytest.approx(1.0, abs=0.034)


@quick
@given(
    seed=seeds,
    error_rad=st.sampled_from([0.0, 1e-3, 0.1]),
    baseline_m=st.sampled_from([1e-3, 0.1, 1.0]),
)
def test_the_full_derivative_of_the_residual(seed, error_rad, baseline_m):
    view = two_views(seed, 3, error_rad=error_rad, baseline_m=baseline_m)
    for i in range(3):
        residual, J = sampson_jacobian(view, i)

        def along(step: np.ndarray, i: int = i) -> float:
            return sampson(view.pairs, *moved(view.R, view.t, step), i)

        assert residual == pytest.approx(along(np.zeros(5)), rel=1e-12)
        # Close to the epipole the residual bends strongly: the step stays well inside.
        numeric = gradient(along, 5, 1e-4 * baseline_m)
        scale = np.abs(numeric).max()
        np.testing.assert_allclose(J, numeric, rtol=1e-4, atol=1e-5 * scale)


@quick
@given(
    seed=seeds,
    error_rad=st.sampled_from([0.0, 1e-2, 0.1]),
    baseline_m=st.sampled_from([0.1, 1.0]),
)
def test_the_second_derivative_of_the_residual(seed, error_rad, baseline_m):
    view = two_views(seed, 2, error_rad=error_rad, baseline_m=baseline_m)

    def along(step: np.ndarray) -> float:
        return sampson(view.pairs, *moved(view.R, view.t, step), 0)

    residual, J, K = sampson_curvature(view, 0)
    np.testing.assert_array_equal(K, K.T)
    # Two ways to write the same residual: they may differ in the last digits.
    expected, first = sampson_jacobian(view, 0)
    assert residual == pytest.approx(expected, rel=1e-9, abs=1e-9)
    np.testing.assert_allclose(J, first, rtol=1e-8, atol=1e-8 * np.abs(first).max())
    for k, axis in enumerate(np.eye(5)):
        # d2r/dk dj by polarisation: second differences along k + j, and along k and j alone.
        for j, other in enumerate(np.eye(5)[: k + 1]):
            direction = axis + other
            both = second_difference(along, direction, 2e-3 * baseline_m)
            alone = [second_difference(along, e, 2e-3 * baseline_m) for e in (axis, other)]
            numeric = 0.5 * (both - sum(alone))
            assert K[k, j] == pytest.approx(numeric, abs=2e-3 * max(np.abs(K).max(), abs(both)))


def parallax(view: View, R: np.ndarray, i: int) -> tuple[float, np.ndarray]:
    by_theta = np.full(3, np.nan)
    return epipolar.parallax(view.pairs, R, view.t, i, by_theta), by_theta


@quick
@given(seed=seeds, baseline_m=st.sampled_from([1e-3, 1e-2]))
def test_parallax_is_the_shift_towards_the_direction_over_its_sigma(seed, baseline_m):
    view = two_views(seed, 3, baseline_m=baseline_m)
    for i in range(3):
        a, b, A, B = (array[i] for array in view.pairs)
        m = view.R @ a
        along = sphere.normalize(view.t - (view.t @ m) * m)
        sigma = np.hypot(np.linalg.norm((view.R @ A).T @ along), np.linalg.norm(B.T @ along))
        shift, by_theta = parallax(view, view.R, i)
        assert shift == pytest.approx((b - m) @ along / sigma, rel=1e-6)
        assert shift > 0.0

        def turned(dtheta: np.ndarray, i: int = i) -> float:
            return parallax(view, so3.exp(dtheta) @ view.R, i)[0]

        # The direction and the noise along the flow are taken for constant.
        numeric = gradient(turned, 3, 1e-6)
        bound = 1e-2 + 4.0 * baseline_m
        np.testing.assert_allclose(by_theta, numeric, rtol=0.0, atol=bound * np.abs(numeric).max())


def second_difference(function: Callable, direction: np.ndarray, step: float) -> float:
    """Second derivative along a direction, with one Richardson extrapolation."""

    def bend(h: float) -> float:
        far = function(h * direction) + function(-h * direction)
        return (far - 2.0 * function(np.zeros(5))) / h**2

    return (4.0 * bend(step / 2) - bend(step)) / 3.0


def test_the_weight_has_a_derivative_that_matters():
    # With the weight frozen (trap 1), the derivative would be that of the constraint alone.
    view = two_views(3, 1, error_rad=0.05)
    a, b, _, _ = (array[0] for array in view.pairs)
    residual, J = sampson_jacobian(view, 0)
    m = view.R @ a
    constraint = b @ np.cross(view.t, m)
    by_theta = np.cross(m, np.cross(b, view.t)) * residual / constraint
    assert np.linalg.norm(J[:3] - by_theta) > 0.02 * np.linalg.norm(by_theta)


def test_a_match_at_the_epipole_satisfies_every_plane():
    axis = np.array([[0.0, 0.0, 1.0]])
    flat = sphere.tangent_basis(axis)
    # The variance of the constraint is exactly zero there: no division by it.
    at = View(RayPairs(axis, axis, flat, flat), np.eye(3), axis[0])
    assert sampson(at.pairs, at.R, at.t, 0) == 0.0
    for residual, *derivatives in (sampson_jacobian(at, 0), sampson_curvature(at, 0)):
        assert residual == 0.0
        assert not any(derivative.any() for derivative in derivatives)
