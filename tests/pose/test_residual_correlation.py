"""Correlation of residuals, and the design effect."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from farpoint.geometry import sphere
from farpoint.pose.constants import CORRELATED_Z, PART_SPLITS
from farpoint.pose.matches import matches_from_rays
from farpoint.pose.residual_correlation import ResidualCorrelation, design_effect

PARTS = 2**PART_SPLITS
# The degrees of freedom of a pose are subtracted although none was fitted.
UNFITTED = PARTS / (PARTS - 5.0)


def rays_of(seed: int, count: int) -> np.ndarray:
    """Rays (N, 3) of a camera with a field of view of 90 deg."""
    places = np.random.default_rng((seed, 1)).uniform(-1.0, 1.0, (count, 2))
    return sphere.normalize(np.c_[places, np.ones(count)])


def plainly(rays: np.ndarray, residual: np.ndarray) -> float:
    """Reference implementation in plain NumPy."""
    parts = [np.arange(len(rays))]
    for _ in range(4):
        halves = []
        for part in parts:
            ray = rays[part, np.argmax(np.var(rays[part], axis=0))]
            halves += [part[ray <= ray.mean()], part[ray > ray.mean()]]
        parts = halves
    scatter = sum(residual[part].sum() ** 2 / len(part) for part in parts if len(part))
    used = sum(len(part) > 0 for part in parts)
    return float(scatter / np.mean(residual**2) / (used - 5.0))


@pytest.mark.parametrize("matches", [60, 500])
def test_sixteen_parts_split_where_they_are_longest(matches):
    rays, residual = rays_of(1, matches), np.random.default_rng(1).normal(0.0, 1.5, matches)
    assert design_effect(rays, residual) == pytest.approx(plainly(rays, residual))


def test_parts_of_a_lens_that_sees_all_around():
    rays = sphere.normalize(np.random.default_rng(3).normal(size=(300, 3)))
    residual = np.random.default_rng(4).normal(size=300)
    assert design_effect(rays, residual) == pytest.approx(plainly(rays, residual))


def test_of_noise_it_is_one():
    effects = [
        design_effect(rays_of(seed, 200), np.random.default_rng(seed).normal(size=200))
        for seed in range(200)
    ]
    # Each has 16 degrees of freedom: a scatter of 0.35, of 200 of them 0.025.
    assert np.mean(effects) == pytest.approx(UNFITTED, abs=0.12)
    assert np.std(effects) == pytest.approx(UNFITTED * np.sqrt(2.0 / PARTS), rel=0.25)


def test_what_a_part_has_in_common_counts_as_often_as_it_has_matches():
    rays, rng = rays_of(5, 800), np.random.default_rng(5)
    place = np.floor(3.0 * rays[:, :2] / rays[:, 2:]).astype(int)
    _, cell = np.unique(place, axis=0, return_inverse=True)
    shared = rng.normal(0.0, 0.5, cell.max() + 1)[cell.ravel()]
    shared -= shared.mean()
    noise = rng.normal(size=800)
    chosen = [design_effect(rays, rng.permutation(shared) + noise) for _ in range(20)]
    assert design_effect(rays, shared + noise) > 2.0 * np.max(chosen)


@pytest.mark.parametrize("count", [0, 1, 2, 20])
def test_few_matches_or_none_have_no_design_effect(count):
    rays = rays_of(6, count)
    assert design_effect(rays, np.zeros(count)) == 1.0
    assert np.isfinite(design_effect(rays, np.ones(count)))


def test_matches_at_one_point_are_one_part():
    assert design_effect(np.tile(rays_of(7, 1), (30, 1)), np.ones(30)) == 1.0


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_only_inliers_count_and_each_up_to_three_sigma(share):
    rng, rays = np.random.default_rng(8), rays_of(8, 300)
    residual = rng.normal(size=300) + 3.0 * share * np.sin(5.0 * rays[:, 0])
    matches = matches_from_rays(rays, rays, 1e-3)
    alone = ResidualCorrelation.of(matches, residual, np.ones(300))
    if share:
        assert alone.z_score > 2.0 * CORRELATED_Z
        bounded = np.clip(residual, -3.0, 3.0)
        assert alone.design_effect == pytest.approx(design_effect(rays, bounded))
        assert alone.design_effect > 2.0
    else:
        assert (alone.z_score < CORRELATED_Z, alone.design_effect) == (True, 1.0)
    # Wrong matches among them: the inliers stay the same.
    wrong = np.array([rays_of(9, 40), rays_of(10, 40)])
    among = matches_from_rays(
        np.concatenate([wrong[0], rays]), np.concatenate([wrong[1], rays]), 1e-3
    )
    given = np.concatenate([np.full(40, 50.0), residual]), np.repeat([0.1, 0.9], [40, 300])
    assert ResidualCorrelation.of(among, *given) == pytest.approx(alone)


def test_the_correlation_is_that_of_the_nearest_inliers_in_any_order():
    rng, rays = np.random.default_rng(12), rays_of(12, 300)
    residual = rng.normal(size=300) + np.sin(5.0 * rays[:, 0])
    found = ResidualCorrelation.of(matches_from_rays(rays, rays, 1e-3), residual, np.ones(300))
    _, nearest = cKDTree(rays).query(rays, k=2)
    bounded = np.clip(residual, -3.0, 3.0)
    expected = bounded @ bounded[nearest[:, 1]] / (bounded @ bounded)
    assert found.correlation == pytest.approx(expected)


def test_few_inliers_have_no_correlation():
    rays = rays_of(11, 49)
    matches = matches_from_rays(rays, rays, 1e-3)
    assert ResidualCorrelation.of(matches, np.ones(49), np.ones(49)) == (0.0, 0.0, 1.0)
