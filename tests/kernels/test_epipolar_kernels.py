"""The Sampson residual and its full derivatives against differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kernels_kit import View, gradient, moved, shaken, two_views

from farpoint._kernels import epipolar
from farpoint._kernels.compile import kernel
from farpoint._kernels.pairs import address, ray0, ray1
from farpoint._kernels.vectors import matrix, rotate, tangent_columns, vector
from farpoint.geometry import sphere

quick = settings(max_examples=25, deadline=None)
seeds = st.integers(0, 2**32)


@kernel
def residual_of(pairs: np.ndarray, i: int, R: np.ndarray, t: np.ndarray) -> float:
    return epipolar.sampson(pairs, address(i), matrix(R), vector(t))


@kernel
def derivatives_of(pairs: np.ndarray, i: int, R: np.ndarray, t: np.ndarray) -> tuple:
    direction = vector(t)
    return epipolar.sampson_jacobian(
        pairs, address(i), matrix(R), direction, tangent_columns(direction)
    )


@kernel
def shift_of(pairs: np.ndarray, i: int, R: np.ndarray, t: np.ndarray) -> tuple:
    """Flow along the line, squared sine and variance of the flow; result of `variances`."""
    at, rotation, direction = address(i), matrix(R), vector(t)
    m = rotate(rotation, ray0(pairs, at))
    flow, reach2 = epipolar.flow_along(m, ray1(pairs, at), direction)
    return (
        flow,
        reach2,
        epipolar.parallax_variance(pairs, at, rotation, m, direction),
        epipolar.variances(pairs, at, rotation, direction),
    )


@kernel
def shift_derivatives_of(pairs: np.ndarray, i: int, R: np.ndarray, t: np.ndarray) -> tuple:
    direction = vector(t)
    return epipolar.shift_jacobian(
        pairs, address(i), matrix(R), direction, tangent_columns(direction)
    )


def sampson(view: View, R: np.ndarray, t: np.ndarray, i: int) -> float:
    return residual_of(view.pairs, i, R, t)


def sampson_jacobian(view: View, i: int) -> tuple[float, np.ndarray]:
    *J, residual = derivatives_of(view.pairs, i, view.R, view.t)
    return residual, np.array(J)


@quick
@given(seed=seeds, error_rad=st.sampled_from([0.0, 1e-3, 0.3]))
def test_the_residual_is_the_constraint_over_its_own_sigma(seed, error_rad):
    view = two_views(seed, 3, error_rad=error_rad)
    a, b, A, B = (array[0] for array in view[:4])

    def constraint(n: np.ndarray) -> float:
        return (b + B @ n[2:]) @ np.cross(view.t, view.R @ (a + A @ n[:2]))

    # The constraint is linear in each of the four coordinates of noise: differences are exact.
    sigma = np.linalg.norm(gradient(constraint, 4, 1.0))
    residual = sampson(view, view.R, view.t, 0)
    assert residual == pytest.approx(constraint(np.zeros(4)) / sigma, rel=1e-9, abs=1e-9)
    if error_rad == 0.0:
        assert residual == pytest.approx(0.0, abs=1e-9)


def test_the_residual_of_noise_is_distributed_as_one_coordinate_of_it():
    view = shaken(two_views(5, 4000, noise_rad=1e-4), seed=6)
    pairs = view.pairs
    residual = [residual_of(pairs, i, view.R, view.t) for i in range(view.size)]
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
            return sampson(view, *moved(view.R, view.t, step), i)

        assert residual == pytest.approx(along(np.zeros(5)), rel=1e-12)
        # Close to the epipole the residual is strongly non-linear: the step stays well inside.
        numeric = gradient(along, 5, 1e-4 * baseline_m)
        scale = np.abs(numeric).max()
        np.testing.assert_allclose(J, numeric, rtol=1e-4, atol=1e-5 * scale)


@quick
@given(seed=seeds, baseline_m=st.sampled_from([1e-3, 1e-2, 0.5]))
def test_the_shift_towards_the_direction_and_its_variance(seed, baseline_m):
    view = two_views(seed, 3, baseline_m=baseline_m)
    for i in range(3):
        a, b, A, B = (array[i] for array in view[:4])
        m = view.R @ a
        along = view.t - (view.t @ m) * m
        flow, reach2, variance, _ = shift_of(view.pairs, i, view.R, view.t)
        assert flow == pytest.approx(b @ along, abs=1e-12)
        assert flow > 0.0
        assert reach2 == pytest.approx(along @ along, rel=1e-9)
        noise = np.concatenate([(view.R @ A).T @ along, B.T @ along])
        assert variance == pytest.approx(noise @ noise, rel=1e-9)


@quick
@given(seed=seeds)
def test_variances_of_the_constraint_and_of_the_flow_given_the_residual(seed):
    view = two_views(seed, 3, error_rad=1e-2)
    for i in range(3):
        a, b, A, B = (array[i] for array in view[:4])
        m, along = view.R @ a, view.t - (view.t @ view.R @ a) * (view.R @ a)
        # Rows: constraint and flow by the four coordinates of noise.
        J = np.array(
            [
                np.r_[np.cross(b, view.t) @ view.R @ A, np.cross(view.t, m) @ B],
                np.r_[-along @ view.R @ A, along @ B],
            ]
        )
        C = J @ J.T
        g, v = shift_of(view.pairs, i, view.R, view.t)[3]
        assert g == pytest.approx(C[0, 0], rel=1e-9)
        assert v == pytest.approx(np.linalg.det(C) / C[0, 0], rel=1e-7)


def test_the_weight_has_a_derivative_that_matters():
    # With the weight frozen (trap 1), the derivative would be that of the constraint alone.
    view = two_views(3, 1, error_rad=0.05)
    a, b = view.rays0[0], view.rays1[0]
    residual, J = sampson_jacobian(view, 0)
    m = view.R @ a
    constraint = b @ np.cross(view.t, m)
    by_theta = np.cross(m, np.cross(b, view.t)) * residual / constraint
    assert np.linalg.norm(J[:3] - by_theta) > 0.02 * np.linalg.norm(by_theta)


def test_a_match_at_the_epipole_satisfies_every_plane():
    axis = np.array([[0.0, 0.0, 1.0]])
    flat = sphere.tangent_basis(axis)
    # The variance of the constraint is exactly zero there: no division by it.
    at = View(axis, axis, flat, flat, np.eye(3), axis[0])
    assert sampson(at, at.R, at.t, 0) == 0.0
    residual, derivative = sampson_jacobian(at, 0)
    assert residual == 0.0
    assert not derivative.any()


@quick
@given(seed=seeds)
def test_derivative_of_the_shift_but_for_that_of_its_variance(seed):
    view = two_views(seed, 1, error_rad=1e-3, baseline_m=0.1)

    def flow(step: np.ndarray) -> float:
        return shift_of(view.pairs, 0, *moved(view.R, view.t, step))[0]

    value, _, variance, _ = shift_of(view.pairs, 0, view.R, view.t)
    *J, shift = shift_derivatives_of(view.pairs, 0, view.R, view.t)
    assert shift == pytest.approx(value / np.sqrt(variance), rel=1e-9)
    expected = gradient(flow, 5, 1e-4) / np.sqrt(variance)
    np.testing.assert_allclose(J, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())
