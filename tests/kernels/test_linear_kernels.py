"""Small linear algebra of the kernels against NumPy, SciPy and published numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from farpoint._kernels import linear
from farpoint.geometry import so3, sphere

quick = settings(max_examples=60, deadline=None)
vectors = arrays(np.float64, 3, elements=st.floats(-3.0, 3.0))
seeds = st.integers(0, 2**32)


def kabsch(M: np.ndarray) -> np.ndarray | None:
    R = np.full((3, 3), np.nan)
    return R if linear.kabsch(np.ascontiguousarray(M, dtype=float), R) else None


def rotated(R: np.ndarray, v: np.ndarray) -> np.ndarray:
    out = np.full((3, 3), np.nan)
    linear.apply_rotation_step(R, v[0], v[1], v[2], out)
    return out


def draws(state: int, n: int, count: int) -> list[int]:
    words = np.array([state], np.uint64)
    return [linear.draw_index(words, n) for _ in range(count)]


def basis_of(d: np.ndarray) -> np.ndarray:
    basis = np.full((3, 2), np.nan)
    linear.tangent_basis(d, basis)
    return basis


def by_svd(M: np.ndarray) -> np.ndarray:
    U, _, Vt = np.linalg.svd(M)
    return U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt


def cross_covariance(rays0: np.ndarray, rays1: np.ndarray) -> np.ndarray:
    return np.einsum("ni,nj->ij", rays1, rays0)


@quick
@given(seed=seeds)
def test_kabsch_is_the_svd_of_any_matrix_reflections_included(seed):
    M = np.random.default_rng(seed).normal(size=(3, 3))
    R = kabsch(M)
    assert R is not None
    np.testing.assert_allclose(R @ R.T, np.eye(3), rtol=0.0, atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0, abs=1e-12)
    # A rotation between two almost equal singular values is undetermined; its quality is not.
    assert np.trace(R.T @ M) == pytest.approx(np.trace(by_svd(M).T @ M), abs=1e-10)
    gap = np.linalg.svd(M, compute_uv=False) @ [0.0, 1.0, np.sign(np.linalg.det(M))]
    if gap > 1e-2:
        np.testing.assert_allclose(R, by_svd(M), rtol=0.0, atol=1e-9)


@quick
@given(
    v=vectors,
    seed=seeds,
    count=st.integers(3, 10),
    noise=st.sampled_from([0.0, 1e-6, 1e-2]),
    scale=st.sampled_from([1e-6, 1.0, 1e6]),
)
def test_kabsch_aligns_rays_as_scipy_does(v, seed, count, noise, scale):
    rng = np.random.default_rng(seed)
    rays0 = sphere.normalize(rng.normal(size=(count, 3)))
    rays1 = rays0 @ so3.exp(v).T + noise * rng.normal(size=(count, 3))
    R = kabsch(scale * cross_covariance(rays0, rays1))
    assert R is not None
    aligned = Rotation.align_vectors(rays1, rays0)[0].as_matrix()
    assert so3.angle_between(R, aligned) < 1e-7
    if noise == 0.0:
        assert so3.angle_between(R, so3.exp(v)) < 1e-7


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1.0, math.pi - 1e-9, math.pi])
def test_two_rays_are_enough_up_to_half_a_turn(angle):
    rays0 = sphere.normalize(np.array([[1.0, 2.0, 2.0], [-2.0, 0.5, 1.0]]))
    truth = so3.exp(angle * sphere.normalize(np.array([0.2, -0.9, 0.4])))
    R = kabsch(cross_covariance(rays0, rays0 @ truth.T))
    assert R is not None
    np.testing.assert_allclose(R, truth, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("width_rad", [0.1, 1e-2, 2e-3])
def test_kabsch_aligns_what_a_narrow_view_sees(width_rad):
    rng = np.random.default_rng(0)
    rays0 = sphere.normalize(np.c_[width_rad * rng.uniform(-1, 1, (50, 2)), np.ones(50)])
    truth = so3.exp(np.array([0.3, -0.2, 0.5]))
    R = kabsch(cross_covariance(rays0, rays0 @ truth.T))
    assert R is not None
    np.testing.assert_allclose(R @ R.T, np.eye(3), rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(R, truth, rtol=0.0, atol=1e-12 / width_rad**2)


@pytest.mark.parametrize(
    "M",
    [
        np.zeros((3, 3)),
        np.outer([1.0, 2.0, 3.0], [3.0, -1.0, 2.0]),
        np.outer([0.0, 0.0, 1.0], [0.0, 0.0, 1.0]),
        np.full((3, 3), np.nan),
    ],
    ids=["zero", "rank one", "one axis", "nan"],
)
def test_kabsch_returns_false_without_a_unique_rotation(M):
    assert kabsch(M) is None


@quick
@given(seed=seeds, scale=st.sampled_from([1.0, 1e8]))
def test_the_sandwich_of_what_is_left_of_a_matrix(seed, scale):
    rng = np.random.default_rng(seed)
    roots = np.diag([scale, 1.0, 1.0, 1.0, 1.0]) @ rng.normal(size=(5, 12))
    V = roots @ roots.T
    part = 0.9 * roots[:, :5] @ roots[:, :5].T
    inner = roots @ np.diag(rng.uniform(0.5, 2.0, 12)) @ roots.T
    H = V - part
    out = np.full((5, 5), np.nan)
    assert linear.sandwich(V, part, inner, 0.05, out)
    expected = np.linalg.solve(H, np.linalg.solve(H, inner).T)
    unit = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        out / np.outer(unit, unit), expected / np.outer(unit, unit), atol=1e-6
    )
    np.testing.assert_array_equal(out, out.T)


def test_the_sandwich_returns_false_without_enough_signal():
    V = np.diag([4.0, 1.0, 1.0, 1.0, 1.0])
    inner, out = 0.1 * V, np.zeros((5, 5))
    # 10 % of the first direction are left.
    assert linear.sandwich(V, np.diag([3.6, 0.0, 0.0, 0.0, 0.0]), inner, 0.05, out)
    assert out[0, 0] == pytest.approx(0.4 / 0.4**2)
    assert not linear.sandwich(V, np.diag([3.6, 0.0, 0.0, 0.0, 0.0]), inner, 0.15, out)
    assert not linear.sandwich(V, np.diag([5.0, 0.0, 0.0, 0.0, 0.0]), inner, 0.05, out)
    assert not linear.sandwich(np.full((5, 5), np.nan), np.zeros((5, 5)), inner, 0.05, out)


@quick
@given(
    v=vectors,
    size=st.sampled_from([0.0, 1e-12, 0.9e-4, 1.1e-4, 1e-2, 1.0, 5.0]),
    start=vectors,
)
def test_a_rotation_step_is_the_exponential_on_the_left(v, size, start):
    R, step = so3.exp(start), size * v
    np.testing.assert_allclose(rotated(R, step), so3.exp(step) @ R, rtol=0.0, atol=4e-14)


@pytest.mark.parametrize("angle", [1e-6, 0.9e-4, 1.1e-4, 1e-3, 0.05, 1.0])
def test_a_rotation_step_turns_by_its_length(angle):
    axis = sphere.normalize(np.array([0.3, -0.5, 0.8]))
    E = rotated(np.eye(3), angle * axis)
    skew = 0.5 * np.array([E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]])
    np.testing.assert_allclose(skew, math.sin(angle) * axis, rtol=1e-13)


def test_a_rotation_step_may_be_made_in_place():
    R, step = so3.exp(np.array([1.0, 2.0, -0.5])), np.array([0.1, -0.2, 0.3])
    expected = rotated(R, step)
    linear.apply_rotation_step(R, *step, R)
    np.testing.assert_array_equal(R, expected)


@quick
@given(d=vectors.filter(lambda v: np.linalg.norm(v) > 0.1).map(sphere.normalize))
def test_the_tangent_basis_is_the_one_of_the_public_results(d):
    # The covariance of a direction is computed in this basis and returned in that of `sphere`.
    np.testing.assert_array_equal(basis_of(d), sphere.tangent_basis(d))


@pytest.mark.parametrize("z", [1.0, -1.0, 0.0, -0.0])
def test_the_tangent_basis_is_whole_where_its_formula_changes_sign(z):
    d = np.array([math.sqrt(1.0 - z * z), 0.0, z])
    frame = np.column_stack([basis_of(d), d])
    np.testing.assert_allclose(frame.T @ frame, np.eye(3), rtol=0.0, atol=1e-15)


def test_random_words_are_splitmix64():
    # Test vector of the reference implementation (Vigna), state 1234567.
    words = [6457827717110365317, 3203168211198807973, 9817491932198370423, 4593380528125082431]
    # Drawn below 2^53, an index is the word's top 53 bits.
    assert draws(1234567, 2**53, 4) == [word >> 11 for word in words]


def test_drawn_directions_are_uniform_on_the_sphere():
    state, drawn = np.array([5], np.uint64), np.empty((4000, 3))
    for d in drawn:
        linear.draw_direction(state, d)
    np.testing.assert_allclose(np.linalg.norm(drawn, axis=1), 1.0, rtol=0.0, atol=1e-14)
    # Mean 0 and second moment I / 3, to four standard errors.
    np.testing.assert_allclose(drawn.mean(axis=0), 0.0, rtol=0.0, atol=4 * 0.58 / 63)
    np.testing.assert_allclose(drawn.T @ drawn / 4000, np.eye(3) / 3, rtol=0.0, atol=4 * 0.3 / 63)


@pytest.mark.parametrize("n", [1, 2, 7, 110])
def test_drawn_indices_are_uniform_and_in_range(n):
    count = 2000
    sample = np.array(draws(2**64 - 1, n, count))
    assert sample.min() >= 0
    assert sample.max() < n
    expected = count / n
    chi2 = np.sum((np.bincount(sample, minlength=n) - expected) ** 2) / expected
    assert chi2 < n - 1 + 4.0 * math.sqrt(2.0 * n)


@quick
@given(seed=seeds, decades=st.floats(0.0, 12.0))
def test_eigenvectors_are_orthonormal_however_far_apart_the_values_are(seed, decades):
    rng = np.random.default_rng(seed)
    values = 10.0 ** rng.uniform(-decades, 0.0, 5) * np.where(rng.random(5) < 0.2, -1.0, 1.0)
    apply_quaternion = np.linalg.qr(rng.normal(size=(5, 5)))[0]
    A = apply_quaternion * values @ apply_quaternion.T
    A = 0.5 * (A + A.T)
    diagonal, axes = A.copy(), np.full((5, 5), np.nan)
    linear.eigen_five(diagonal, axes)
    found = diagonal.diagonal()
    np.testing.assert_allclose(axes @ axes.T, np.eye(5), rtol=0.0, atol=1e-14)
    np.testing.assert_allclose((axes.T * found) @ axes, A, rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(np.sort(found), np.linalg.eigvalsh(A), rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("value", [0.0, math.nan, math.inf])
def test_a_matrix_without_eigenvectors_ends(value):
    linear.eigen_five(np.full((5, 5), value), np.empty((5, 5)))
