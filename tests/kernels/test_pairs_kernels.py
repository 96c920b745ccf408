"""Matches in panels: packed values and filler."""

from __future__ import annotations

import math

import numpy as np
import pytest
from kernels_kit import UNIT, View, rays_only, two_views

from farpoint._kernels.compile import kernel
from farpoint._kernels.constants import LANES, PANEL
from farpoint._kernels.pairs import (
    address,
    flow_variance,
    is_finite,
    noise0,
    noise1,
    pack_pairs,
    packed_length,
    ray0,
    ray1,
    take_pairs,
)
from farpoint._kernels.vectors import vector
from farpoint.geometry import sphere


@kernel
def read(pairs: np.ndarray, i: int, v: np.ndarray) -> tuple:
    """All values of match ``i`` in its panel."""
    at, along = address(i), vector(v)
    return (
        ray0(pairs, at),
        ray1(pairs, at),
        noise0(pairs, at, along),
        noise1(pairs, at, along),
        flow_variance(pairs, at),
    )


def pack(view: View, **jacobian_times: np.ndarray) -> tuple[int, float, np.ndarray, np.ndarray]:
    n = view.size
    pairs, index = np.full(packed_length(n) // LANES * PANEL, np.nan), np.full(n, -1)
    given = {"covariance0": UNIT, "covariance1": UNIT, "least_variance": 0.0} | jacobian_times
    arrays = (np.ascontiguousarray(array) for array in view[:4])
    count, half_width = pack_pairs(
        *arrays, given["covariance0"], given["covariance1"], given["least_variance"], pairs, index
    )
    return count, half_width, pairs, index


def assert_holds(pairs: np.ndarray, i: int, view: View, row: int, C0=UNIT[0], C1=UNIT[0]):
    v = np.array([0.3, -1.2, 0.7])
    first, second, shaken0, shaken1, variance = read(pairs, i, v)
    S0, S1 = (A[row] @ C @ A[row].T for A, C in ((view.noise0, C0), (view.noise1, C1)))
    np.testing.assert_array_equal(first, view.rays0[row])
    np.testing.assert_array_equal(second, view.rays1[row])
    np.testing.assert_allclose(shaken0, S0 @ v, rtol=1e-12, atol=1e-20)
    np.testing.assert_allclose(shaken1, S1 @ v, rtol=1e-12, atol=1e-20)
    assert variance == pytest.approx(0.5 * (np.trace(S0) + np.trace(S1)), rel=1e-12)


@pytest.mark.parametrize("n", [1, LANES - 1, LANES, LANES + 1, 3 * LANES])
def test_rays_and_their_noise_are_kept(n):
    view = two_views(0, n)
    count, _, pairs, index = pack(view)
    assert count == n
    np.testing.assert_array_equal(index, np.arange(n))
    for i in range(n):
        assert_holds(pairs, i, view, i)
    assert np.isfinite(pairs).all()


def test_a_covariance_of_each_match_goes_through_the_factors():
    rng, n = np.random.default_rng(1), 40
    view = two_views(1, n)
    roots = rng.normal(size=(2, n, 2, 2))
    C0, C1 = roots @ roots.transpose(0, 1, 3, 2)
    _, _, pairs, _ = pack(view, covariance0=C0, covariance1=C1)
    for i in range(n):
        assert_holds(pairs, i, view, i, C0[i], C1[i])


def test_matches_without_a_ray_are_left_out():
    view = two_views(2, 50)
    view.rays0[7], view.noise0[7] = np.nan, np.nan
    view.noise1[9] *= 1e-9
    count, _, pairs, index = pack(view, least_variance=1e-12)
    rows = np.delete(np.arange(50), [7, 9])
    assert count == 48
    np.testing.assert_array_equal(index[:48], rows)
    for i, row in enumerate(rows):
        assert_holds(pairs, i, view, row)


def test_taken_matches_are_those_of_the_rows():
    view = two_views(3, 70)
    rows = np.array([69, 0, 31, 32, 5] * 8)
    taken = np.full(packed_length(len(rows)) // LANES * PANEL, np.nan)
    take_pairs(pack(view)[2], rows, taken)
    for i, row in enumerate(rows):
        assert_holds(taken, i, view, row)
    assert np.isfinite(taken).all()


def test_the_outlier_strip_has_the_width_of_the_later_rays():
    rng, half = np.random.default_rng(4), 0.2
    rays = np.c_[rng.uniform(-half, half, (4000, 2)), np.ones(4000)]
    noise = 1e-3 * sphere.tangent_basis(sphere.normalize(rays))
    # Not of unit length, so that they fill a flat square.
    view = rays_only(rays, rays)._replace(noise0=noise, noise1=noise)
    # Noise of a flow: sqrt(1/2 (2 + 2)) = sqrt(2) mrad. Three standard errors are 3 %.
    assert pack(view)[1] == pytest.approx(half / (math.sqrt(2.0) * 1e-3), rel=0.03)


def test_the_half_width_of_outliers_is_at_least_ten_sigma():
    view = two_views(5, 1)
    same = View(*(np.repeat(array, 20, axis=0) for array in view[:4]), view.R, view.t)
    assert pack(same)[1] == 10.0


def test_what_fills_a_panel_up_is_too_vague_to_contradict_a_pose():
    pairs, v = pack(two_views(0, 3))[2], np.array([0.3, -1.2, 0.7])
    for i in range(3, LANES):
        first, second, shaken0, shaken1, variance = read(pairs, i, v)
        assert first == second == (0.0, 0.0, 1.0)
        np.testing.assert_array_equal([shaken0, shaken1], [1e12 * v] * 2)
        assert variance == 1e12


def test_no_match_at_all_fills_no_panel():
    assert pack(two_views(0, 0))[:2] == (0, 10.0)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_one_number_that_is_not_finite_is_found(bad):
    values = np.array([1.0, -1e308, 0.0, 3.0, 5e-324])
    assert is_finite(values)
    assert is_finite(values[:0])
    for i in range(values.size):
        assert not is_finite(np.where(np.arange(values.size) == i, bad, values))
