"""Rays rotated from the time of their row, against the exponential of each row."""

from __future__ import annotations

import numpy as np
import pytest

from farpoint._kernels.row_rotation import RowMotion, unroll_rays
from farpoint.geometry import so3
from farpoint.geometry.sphere import normalize

RATE, TURN = np.array([0.3, -0.2, 0.4]), np.array([-0.1, 0.2, 0.3])
PER_PX = 1e-3
MEANS = np.random.default_rng(5).uniform(-0.5, 0.5, 20)


@pytest.fixture
def rows() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rays (N, 3), derivatives (N, 3, 2), phases (N,)."""
    rng = np.random.default_rng(4)
    return (
        normalize(rng.normal(size=(20, 3))),
        rng.normal(size=(20, 3, 2)),
        rng.uniform(-0.5, 0.5, 20),
    )


def unrolled(
    rays: np.ndarray,
    by_pixel: np.ndarray,
    phases: np.ndarray,
    rate: np.ndarray = RATE,
    turn: np.ndarray = TURN,
):
    motion = RowMotion(rate=rate, turn=turn, per_px=PER_PX)
    found, found_by_pixel = np.empty_like(rays), np.empty_like(by_pixel)
    unroll_rays(rays, by_pixel, phases, MEANS, motion, found, found_by_pixel)
    return found, found_by_pixel


def test_each_row_is_rotated_back_by_its_own_share(rows):
    rays, by_pixel, phases = rows
    R = so3.exp(-MEANS[:, None] * TURN) @ so3.exp(-phases[:, None] * RATE)
    found, _ = unrolled(rays, by_pixel, phases)
    np.testing.assert_allclose(found, np.einsum("nij,nj->ni", R, rays), atol=1e-14)


def test_a_pixel_one_row_lower_is_read_one_row_later(rows):
    """The derivative by the pixel, by central differences of ray and phase."""
    rays, by_pixel, phases = rows
    step = 1e-6
    _, found = unrolled(rays, by_pixel, phases)
    for column, later in ((0, 0.0), (1, PER_PX)):
        ahead, back = (
            unrolled(
                rays + sign * step * by_pixel[:, :, column],
                by_pixel,
                phases + sign * step * later,
            )[0]
            for sign in (1.0, -1.0)
        )
        np.testing.assert_allclose(found[:, :, column], (ahead - back) / (2 * step), atol=1e-8)


def test_without_rotation_nothing_changes(rows):
    rays, by_pixel, phases = rows
    found, found_by_pixel = unrolled(rays, by_pixel, phases, np.zeros(3), np.zeros(3))
    np.testing.assert_array_equal(found, rays)
    np.testing.assert_array_equal(found_by_pixel, by_pixel)
