"""Rotations are a group, Exp and Log each other's inverse, quaternions ``qx qy qz qw``."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.linalg import expm

from farpoint.geometry import so3

vectors = arrays(np.float64, 3, elements=st.floats(-4.0, 4.0))
units = arrays(np.float64, 3, elements=st.floats(-1.0, 1.0)).filter(
    lambda v: np.linalg.norm(v) > 0.1
)
quick = settings(max_examples=100, deadline=None)
HALF = math.sqrt(0.5)


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v)


@quick
@given(a=vectors, b=vectors)
def test_rotations_are_a_group(a, b):
    R, S = so3.exp(a), so3.exp(b)
    for member in (R, R @ S):
        np.testing.assert_allclose(member @ member.T, np.eye(3), rtol=0.0, atol=4e-14)
        assert np.linalg.det(member) == pytest.approx(1.0, abs=1e-13)
    np.testing.assert_allclose(so3.exp(-a), R.T, rtol=0.0, atol=4e-15)
    np.testing.assert_array_equal(so3.exp(np.zeros(3)), np.eye(3))


@quick
@given(v=vectors)
def test_exp_is_the_matrix_exponential_of_the_cross_product(v):
    np.testing.assert_allclose(so3.exp(v), expm(so3.skew(v)), rtol=0.0, atol=1e-13)


@quick
@given(v=vectors, w=vectors)
def test_skew_is_the_cross_product(v, w):
    np.testing.assert_allclose(so3.skew(v) @ w, np.cross(v, w), rtol=0.0, atol=4e-14)


@quick
@given(axis=units, s=st.floats(-3.0, 3.0), t=st.floats(-3.0, 3.0))
def test_turns_about_one_axis_add_up(axis, s, t):
    np.testing.assert_allclose(
        so3.exp(s * axis) @ so3.exp(t * axis), so3.exp((s + t) * axis), rtol=0.0, atol=4e-14
    )


@quick
@given(v=vectors, w=vectors)
def test_a_turned_axis_turns_the_same_way(v, w):
    R = so3.exp(w)
    np.testing.assert_allclose(R @ so3.exp(v) @ R.T, so3.exp(R @ v), rtol=0.0, atol=4e-14)


@quick
@given(axis=units, angle=st.floats(0.0, math.pi - 1e-6))
def test_log_undoes_exp(axis, angle):
    v = angle * unit(axis)
    np.testing.assert_allclose(so3.log(so3.exp(v)), v, rtol=1e-12, atol=4e-14)


@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-16, 1e-9, 1e-4, 1.0])
def test_log_undoes_exp_to_the_last_digits_of_a_small_angle(angle):
    v = angle * unit(np.array([0.3, -0.5, 0.8]))
    np.testing.assert_allclose(so3.log(so3.exp(v)), v, rtol=1e-12, atol=0.0)


@quick
@given(axis=units, gap=st.sampled_from([0.0, 1e-12, 1e-9, 1e-7, 1e-5, 1e-3]))
def test_log_near_half_a_turn_gives_the_same_rotation_and_its_angle(axis, gap):
    R = so3.exp((math.pi - gap) * unit(axis))
    v = so3.log(R)
    assert np.linalg.norm(v) == pytest.approx(math.pi - gap, abs=4e-14)
    np.testing.assert_allclose(so3.exp(v), R, rtol=0.0, atol=4e-14)


@quick
@given(v=vectors, axis=units, angle=st.sampled_from([0.0, 1e-12, 1e-8, 1e-3, 1.0, 3.1, math.pi]))
def test_the_angle_between_rotations_is_that_of_the_turn_from_one_to_the_other(v, axis, angle):
    R = so3.exp(v)
    turned = so3.exp(angle * unit(axis)) @ R
    assert so3.angle_between(R, turned) == pytest.approx(angle, abs=4e-14)
    assert so3.angle_between(turned, R) == pytest.approx(angle, abs=4e-14)


def test_stacks_of_rotations_are_treated_one_by_one():
    v = np.random.default_rng(0).normal(size=(4, 3))
    R = so3.exp(v)
    for k in range(4):
        np.testing.assert_allclose(R[k], so3.exp(v[k]), rtol=0.0, atol=4e-15)
        np.testing.assert_allclose(so3.log(R)[k], so3.log(R[k]), rtol=0.0, atol=4e-15)
        assert so3.angle_between(R, R[0])[k] == pytest.approx(so3.angle_between(R[k], R[0]))


# A quarter turn about an axis carries the next axis into the one after it.
BY_HAND = {
    "none": ((0, 0, 0, 1), [[1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    "quarter about x: y to z": ((HALF, 0, 0, HALF), [[1, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "quarter about y: z to x": ((0, HALF, 0, HALF), [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
    "quarter about z: x to y": ((0, 0, HALF, HALF), [[0, -1, 0], [1, 0, 0], [0, 0, 1]]),
    "half about x": ((1, 0, 0, 0), [[1, 0, 0], [0, -1, 0], [0, 0, -1]]),
    "third about (1,1,1): x to y": ((0.5, 0.5, 0.5, 0.5), [[0, 0, 1], [1, 0, 0], [0, 1, 0]]),
}


@pytest.mark.parametrize(("quat_xyzw", "matrix"), BY_HAND.values(), ids=BY_HAND.keys())
def test_quaternions_worked_out_by_hand(quat_xyzw, matrix):
    q, R = np.array(quat_xyzw), np.array(matrix, dtype=float)
    np.testing.assert_allclose(so3.matrix_from_quat_xyzw(q), R, rtol=0.0, atol=4e-15)
    np.testing.assert_allclose(so3.matrix_from_quat_xyzw(-2.0 * q), R, rtol=0.0, atol=4e-15)
    np.testing.assert_allclose(so3.quat_xyzw_from_matrix(R), q, rtol=0.0, atol=4e-15)


@quick
@given(v=vectors)
def test_quaternions_keep_the_rotation_with_a_positive_real_part_last(v):
    R = so3.exp(v)
    q = so3.quat_xyzw_from_matrix(R)
    assert q[3] >= 0.0
    assert np.linalg.norm(q) == pytest.approx(1.0, abs=4e-15)
    assert abs(q[3]) == pytest.approx(abs(math.cos(np.linalg.norm(v) / 2)), abs=1e-13)
    np.testing.assert_allclose(so3.matrix_from_quat_xyzw(q), R, rtol=0.0, atol=4e-14)


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-9, 1e-3, 1.0, 3.0, 3.14159])
def test_one_rotation_in_plain_numbers_is_what_a_stack_of_them_is(size):
    for axis in ((0.6, -0.48, 0.64), (-0.36, 0.8, 0.48), (0.48, 0.6, -0.64), (1.0, 0.0, 0.0)):
        vector = size * np.array(axis)
        R = so3.exp(vector)
        np.testing.assert_allclose(R, so3.exp(vector[None])[0], rtol=0.0, atol=1e-15)
        assert so3.rotation_vector(R) == pytest.approx(vector, rel=1e-9, abs=1e-30)
        np.testing.assert_allclose(so3.log(R), so3.log(R[None])[0], rtol=1e-9, atol=1e-15)
