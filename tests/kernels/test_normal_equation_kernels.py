"""Normal equations and their solution, against NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from farpoint._kernels import normal_equations
from farpoint._kernels.compile import kernel
from farpoint._kernels.constants import SUMS_OF_FIVE, SUMS_OF_SIX

quick = settings(max_examples=60, deadline=None)
seeds = st.integers(0, 2**32)


@kernel
def gram_of_six(rows: np.ndarray, weights: np.ndarray, out: np.ndarray) -> None:
    sums = SUMS_OF_SIX
    for i in range(rows.shape[0]):
        row = rows[i, 0], rows[i, 1], rows[i, 2], rows[i, 3], rows[i, 4], rows[i, 5]
        sums = normal_equations.add_six(sums, weights[i], row)
    normal_equations.write_six(sums, out)


@kernel
def gram_of_five(rows: np.ndarray, weights: np.ndarray, out: np.ndarray) -> None:
    sums = SUMS_OF_FIVE
    for i in range(rows.shape[0]):
        row = rows[i, 0], rows[i, 1], rows[i, 2], rows[i, 3], rows[i, 4]
        sums = normal_equations.add_five(sums, weights[i], row)
    normal_equations.write_five(sums, out)


@kernel
def solve_five(normal: np.ndarray, damping: float, x: np.ndarray) -> bool:
    return normal_equations.solve_five_spd(normal, damping, x)


@kernel
def decrease_of(normal: np.ndarray, x: np.ndarray) -> tuple:
    return normal_equations.predicted_decrease(normal, x)


@kernel
def solve_three(H: np.ndarray, g: np.ndarray, damping: float, x: np.ndarray) -> bool:
    return normal_equations.solve_three_spd(H, g, damping, x)


@kernel
def size2(H: np.ndarray, row: np.ndarray) -> float:
    inverse, positive = normal_equations.inverse_square(H)
    if not positive:
        return -1.0
    return normal_equations.size2(inverse, (row[0], row[1], row[2], row[3], row[4]))


def damped(H: np.ndarray, damping: float) -> np.ndarray:
    return H + damping * np.diag(np.diag(H))


@pytest.mark.parametrize(("gram", "n"), [(gram_of_five, 5), (gram_of_six, 6)])
def test_rows_are_added_up_with_their_weights(gram, n):
    rng = np.random.default_rng(0)
    rows, weights, out = rng.normal(size=(37, n)), rng.uniform(size=37), np.full((n, n), np.nan)
    gram(rows, weights, out)
    np.testing.assert_allclose(out, rows.T @ (weights[:, None] * rows), rtol=1e-13)
    np.testing.assert_array_equal(out, out.T)


@quick
@given(seed=seeds, damping=st.sampled_from([0.0, 1e-6, 0.1]))
def test_normal_equations_are_solved(seed, damping):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(6, 9))
    normal, x = A @ A.T, np.full(5, np.nan)
    kept = normal.copy()
    assert solve_five(normal, damping, x)
    expected = np.linalg.solve(damped(normal[:5, :5], damping), normal[:5, 5])
    np.testing.assert_allclose(x, expected, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(decrease_of(normal, x), [normal[:5, 5] @ x, x @ x], rtol=1e-12)
    np.testing.assert_array_equal(normal, kept)


@quick
@given(seed=seeds, damping=st.sampled_from([0.0, 1e-6, 0.1]))
def test_three_unknowns_are_solved_for(seed, damping):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(6, 3))
    H, g, x = A.T @ A, rng.normal(size=3), np.full(3, np.nan)
    assert solve_three(H, g, damping, x)
    np.testing.assert_allclose(x, np.linalg.solve(damped(H, damping), g), rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize(
    "H",
    [
        np.zeros((3, 3)),
        np.diag([1.0, -1.0, 1.0]),
        np.array([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        np.ones((3, 3)),
        np.diag([1.0, np.nan, 1.0]),
        np.diag([np.inf, 1.0, 1.0]),
    ],
    ids=["zero", "negative", "indefinite", "singular", "nan", "inf"],
)
def test_matrices_that_are_not_positive_definite_are_reported(H):
    assert not solve_three(H, np.ones(3), 0.0, np.empty(3))


def test_damping_makes_a_singular_system_solvable():
    x = np.empty(3)
    assert solve_three(np.ones((3, 3)), np.ones(3), 0.5, x)
    np.testing.assert_allclose(x, 1.0 / 3.5)


@pytest.mark.parametrize("pivot", range(5))
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_each_of_five_pivots_must_be_positive_and_finite(pivot, value):
    rng = np.random.default_rng(pivot)
    L = np.tril(rng.normal(size=(5, 5)), -1) + np.eye(5)
    D, normal = np.ones(5), np.ones((6, 6))
    normal[:5, :5] = L @ np.diag(D) @ L.T
    assert solve_five(normal, 0.0, np.empty(5))
    D[pivot] = value
    with np.errstate(invalid="ignore"):
        normal[:5, :5] = L @ np.diag(D) @ L.T
    assert not solve_five(normal, 0.0, np.empty(5))


@quick
@given(seed=seeds)
def test_a_row_is_measured_by_the_inverse(seed):
    rng = np.random.default_rng(seed)
    A, row = rng.normal(size=(5, 9)), rng.normal(size=5)
    H = A @ A.T
    assert size2(H, row) == pytest.approx(row @ np.linalg.solve(H, row), rel=1e-7)
    assert size2(np.diag([1.0, 1.0, 0.0, 1.0, 1.0]), row) == -1.0


@kernel
def beside_one(H: np.ndarray) -> tuple:
    return normal_equations.determinant_beside_one(H)


def test_the_determinant_beside_one():
    A = np.random.default_rng(3).normal(size=(6, 9))
    H = A @ A.T
    determinant, positive = beside_one(H)
    assert positive
    assert determinant == pytest.approx(np.linalg.det(H[:5, :5] + np.eye(5)), rel=1e-9)
    assert not beside_one(-3.0 * np.eye(6))[1]
