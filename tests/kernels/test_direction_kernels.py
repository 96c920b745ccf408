"""Intersections of great circles, single and in pairs, against plain NumPy."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kernels_kit import View, rays_only, two_views

from farpoint._kernels import direction
from farpoint.geometry import so3, sphere

quick = settings(max_examples=30, deadline=None)
seeds = st.integers(0, 2**32)


def intersect(view: View, R: np.ndarray, i: int, j: int) -> np.ndarray | None:
    t = np.full(3, np.nan)
    return t if direction.intersect_circles(view.pairs, R, i, j, t) else None


def pairwise(view: View, weight: np.ndarray, R: np.ndarray) -> np.ndarray:
    partial = np.full((len(weight), 3), np.nan)
    direction.pairwise_direction(view.pairs, weight, R, partial)
    return partial


def plain_pairwise(rays0, rays1, weight, R) -> np.ndarray:
    """Sum over pairs of ``w_i w_j c_ij (n_i x n_j)``, c_ij so that both flows point along it."""
    rotated = rays0 @ R.T
    across = np.cross(rotated, rays1)
    # Unit flow, its length taken as the sine of its angle.
    normals = sphere.normalize(across)
    flows = (rays1 - rotated) / np.linalg.norm(across, axis=1, keepdims=True)
    total = np.zeros(3)
    for i, j in itertools.combinations(range(len(rays0)), 2):
        crossing = np.cross(normals[i], normals[j])
        sign = 1.0 if crossing @ (flows[i] + flows[j]) >= 0.0 else -1.0
        total += weight[i] * weight[j] * sign * crossing
    return total


@quick
@given(seed=seeds)
def test_two_exact_matches_meet_at_the_direction_they_flow_to(seed):
    view = two_views(seed, 2)
    t = intersect(view, view.R, 0, 1)
    assert t is not None
    assert sphere.angle_between(t, view.t) < 1e-6


@pytest.mark.parametrize(
    "t", [[1, 0, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1], [0.6, 0, -0.8]], ids=str
)
def test_a_direction_at_90_degrees_or_behind_is_an_ordinary_one(t):
    t, R = np.array(t, dtype=float), so3.exp(np.array([0.1, -0.2, 0.3]))
    rays0 = sphere.normalize(np.array([[0.3, 0.2, 1.0], [-0.4, 0.1, 1.0]]))
    rays1 = sphere.normalize(np.array([[3.0], [5.0]]) * rays0 @ R.T + t)
    found = intersect(rays_only(rays0, rays1), R, 0, 1)
    np.testing.assert_allclose(found, t, rtol=0.0, atol=1e-12)


def test_matches_without_flow_or_on_one_circle_do_not_meet():
    ray = np.array([0.0, 0.0, 1.0])
    rotated = sphere.normalize(np.array([0.1, 0.0, 1.0]))
    still = rays_only(np.stack([ray, ray]), np.stack([ray, rotated]))
    assert intersect(still, np.eye(3), 0, 1) is None
    # Both along the circle y = 0, exactly.
    same = rays_only(np.stack([ray, rotated]), np.stack([rotated, ray]))
    assert intersect(same, np.eye(3), 0, 1) is None
    assert intersect(same, np.eye(3), 0, 0) is None


@quick
@given(seed=seeds, n=st.integers(2, 12))
def test_pairwise_sums_are_those_of_a_plain_loop(seed, n):
    view = two_views(seed, n, error_rad=1e-2)
    weight = np.random.default_rng(seed).uniform(0.0, 1.0, n)
    weight[seed % n] = 0.0
    partial = pairwise(view, weight, view.R)
    expected = plain_pairwise(view.rays0, view.rays1, weight, view.R)
    # Each pair is in the rows of both of its matches.
    np.testing.assert_allclose(partial.sum(axis=0) / 2, expected, rtol=1e-9, atol=1e-12)


@quick
@given(seed=seeds, n=st.integers(3, 10))
def test_taking_off_a_row_leaves_the_sum_without_that_match(seed, n):
    view = two_views(seed, n, error_rad=1e-2)
    weight = np.random.default_rng(seed).uniform(0.1, 1.0, n)
    partial = pairwise(view, weight, view.R)
    total = partial.sum(axis=0) / 2
    for i in range(n):
        rest = np.arange(n) != i
        expected = plain_pairwise(view.rays0[rest], view.rays1[rest], weight[rest], view.R)
        np.testing.assert_allclose(total - partial[i], expected, rtol=1e-9, atol=1e-12)


@quick
@given(seed=seeds)
def test_exact_matches_add_up_along_the_direction(seed):
    view = two_views(seed, 10)
    total = pairwise(view, np.ones(10), view.R).sum(axis=0)
    assert sphere.angle_between(sphere.normalize(total), view.t) < 1e-6


def test_a_match_without_flow_adds_nothing():
    view = two_views(1, 6)
    rays1 = view.rays1.copy()
    # Without rotation of the first ray its flow is exactly zero.
    R, rays0 = np.eye(3), view.rays0
    rays1[0] = rays0[0]
    partial = pairwise(rays_only(rays0, rays1), np.ones(6), R)
    np.testing.assert_array_equal(partial[0], np.zeros(3))
    assert np.isfinite(partial).all()
