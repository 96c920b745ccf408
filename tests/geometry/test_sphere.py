"""Directions: bases are orthonormal everywhere, steps stay on the sphere, angles keep digits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from farpoint.geometry import so3, sphere

quick = settings(max_examples=200, deadline=None)
directions = (
    arrays(np.float64, 3, elements=st.floats(-1.0, 1.0))
    .filter(lambda v: np.linalg.norm(v) > 0.01)
    .map(lambda v: v / np.linalg.norm(v))
)
steps = arrays(np.float64, 2, elements=st.floats(-3.0, 3.0))
X, Z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


@quick
@given(d=directions)
@example(d=Z)
@example(d=-Z)
@example(d=X)
@example(d=np.array([0.6, -0.8, -0.0]))
@example(d=np.array([0.6, -0.8, 0.0]))
@example(d=np.array([1e-9, -1e-9, -1.0]))
@example(d=np.array([1e-160, 0.0, -1.0]))
def test_the_tangent_basis_is_orthonormal_and_perpendicular_everywhere(d):
    frame = np.column_stack([sphere.tangent_basis(d), d])
    np.testing.assert_allclose(frame.T @ frame, np.eye(3), rtol=0.0, atol=4e-15)


def test_bases_of_many_directions_are_those_of_each():
    d = sphere.normalize(np.random.default_rng(0).normal(size=(7, 3)))
    bases = sphere.tangent_basis(d)
    assert bases.shape == (7, 3, 2)
    for k in range(7):
        np.testing.assert_array_equal(bases[k], sphere.tangent_basis(d[k]))


@quick
@given(d=directions, step=steps)
def test_a_step_stays_on_the_sphere_and_can_be_read_back(d, step):
    basis = sphere.tangent_basis(d)
    moved = sphere.retract(d, basis, step)
    assert np.linalg.norm(moved) == pytest.approx(1.0, abs=4e-15)
    np.testing.assert_allclose(basis.T @ moved / (d @ moved), step, rtol=0.0, atol=1e-13)
    assert sphere.angle_between(d, moved) == pytest.approx(
        math.atan(np.linalg.norm(step)), abs=1e-14
    )


@quick
@given(d=directions)
def test_no_step_leads_nowhere_and_a_small_one_along_the_basis(d):
    basis = sphere.tangent_basis(d)
    np.testing.assert_allclose(sphere.retract(d, basis, np.zeros(2)), d, rtol=0.0, atol=4e-16)
    for k in range(2):
        step = np.eye(2)[k] * 1e-6
        slope = (sphere.retract(d, basis, step) - sphere.retract(d, basis, -step)) / 2e-6
        np.testing.assert_allclose(slope, basis[:, k], rtol=0.0, atol=1e-9)


@quick
@given(
    d=directions,
    angle=st.sampled_from([0.0, 1e-300, 1e-12, 1e-8, 1e-3, 1.0, math.pi / 2, 3.0, math.pi - 1e-9]),
)
def test_angles_between_directions_keep_their_digits_near_0_and_pi(d, angle):
    side = sphere.tangent_basis(d)[:, 0]
    turned = math.cos(angle) * d + math.sin(angle) * side
    assert sphere.angle_between(d, turned) == pytest.approx(angle, abs=2e-15)
    assert sphere.angle_between(turned, -d) == pytest.approx(math.pi - angle, abs=4e-15)


@quick
@given(a=directions, b=directions, v=arrays(np.float64, 3, elements=st.floats(-3, 3)))
def test_angles_do_not_change_when_both_directions_turn(a, b, v):
    R = so3.exp(v)
    assert sphere.angle_between(R @ a, R @ b) == pytest.approx(
        sphere.angle_between(a, b), abs=1e-14
    )


def test_normalize_keeps_the_direction_of_each_row():
    v = np.array([[3.0, 0.0, 4.0], [0.0, -1e-8, 0.0]])
    np.testing.assert_allclose(sphere.normalize(v), [[0.6, 0.0, 0.8], [0.0, -1.0, 0.0]])


def test_a_confidence_ring_needs_no_lens():
    sideways = np.array([1.0, 0.0, 0.0])
    across = np.eye(3) - np.outer(sideways, sideways)
    ring = sphere.confidence_ring(sideways, 0.01**2 * across, 0.95, points=32)
    assert ring.shape == (32, 3)
    angles = np.arccos(ring @ sideways)
    np.testing.assert_allclose(angles, np.arctan(0.01 * 2.4477468), rtol=1e-4)
