"""Design effect of residuals."""

from __future__ import annotations

import numpy as np
import pytest
from kernels_kit import View, two_views

from farpoint._kernels.constants import IMAGE_PARTS
from farpoint._kernels.design_effect import design_effect
from farpoint.geometry import sphere

# The degrees of freedom of a pose are subtracted although none was fitted.
UNFITTED = IMAGE_PARTS / (IMAGE_PARTS - 5.0)


def effect(view: View, residual: np.ndarray, rows: np.ndarray | None = None) -> float:
    rows = np.arange(view.size) if rows is None else rows
    return design_effect(view.pairs, residual, rows, 1.0)


def plainly(rays: np.ndarray, residual: np.ndarray) -> float:
    """Reference implementation in plain NumPy."""
    parts = [np.arange(len(rays))]
    for _ in range(4):
        halves = []
        for part in parts:
            ray = rays[part, np.argmax(np.var(rays[part], axis=0))]
            halves += [part[ray <= ray.mean()], part[ray > ray.mean()]]
        parts = halves
    own = np.clip(residual, -3.0, 3.0)
    scatter = sum(own[part].sum() ** 2 / len(part) for part in parts if len(part))
    used = sum(len(part) > 0 for part in parts)
    return scatter / np.mean(own**2) / (used - 5.0)


@pytest.mark.parametrize("matches", [60, 500])
def test_sixteen_parts_split_where_they_are_longest(matches):
    view = two_views(1, matches)
    residual = np.random.default_rng(1).normal(0.0, 1.5, matches)
    assert effect(view, residual) == pytest.approx(plainly(view.rays0, residual))
    rows = np.flatnonzero(np.random.default_rng(2).uniform(size=matches) > 0.3)
    assert effect(view, residual, rows) == pytest.approx(plainly(view.rays0[rows], residual[rows]))


def test_parts_of_a_lens_that_sees_all_around():
    rays = sphere.normalize(np.random.default_rng(3).normal(size=(300, 3)))
    view = two_views(3, 300)._replace(rays0=rays)
    residual = np.random.default_rng(4).normal(size=300)
    assert effect(view, residual) == pytest.approx(plainly(rays, residual))


def test_of_noise_it_is_one():
    effects = [
        effect(two_views(seed, 200), np.random.default_rng(seed).normal(size=200))
        for seed in range(200)
    ]
    # Each has 16 degrees of freedom: a scatter of 0.35, of 200 of them 0.025.
    assert np.mean(effects) == pytest.approx(UNFITTED, abs=0.12)
    assert np.std(effects) == pytest.approx(UNFITTED * np.sqrt(2.0 / IMAGE_PARTS), rel=0.25)


def test_what_a_part_has_in_common_counts_as_often_as_it_has_matches():
    view, rng = two_views(5, 800), np.random.default_rng(5)
    place = np.floor(3.0 * view.rays0[:, :2] / view.rays0[:, 2:]).astype(int)
    _, cell = np.unique(place, axis=0, return_inverse=True)
    shared = rng.normal(0.0, 0.5, cell.max() + 1)[cell.ravel()]
    shared -= shared.mean()
    noise = rng.normal(size=800)
    chosen = [effect(view, rng.permutation(shared) + noise) for _ in range(20)]
    assert effect(view, shared + noise) > 2.0 * np.max(chosen)


@pytest.mark.parametrize("count", [1, 2, 20])
def test_few_matches_or_none_have_no_design_effect(count):
    view = two_views(6, count)
    assert effect(view, np.ones(count), np.empty(0, np.int64)) == 1.0
    assert effect(view, np.zeros(count)) == 1.0
    assert np.isfinite(effect(view, np.ones(count)))


def test_matches_at_one_point_are_one_part():
    view = two_views(7, 30)
    assert effect(view._replace(rays0=np.tile(view.rays0[:1], (30, 1))), np.ones(30)) == 1.0
