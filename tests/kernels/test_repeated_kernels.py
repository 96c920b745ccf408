"""Whether wrong matches lie about their epipolar lines for a reason."""

from __future__ import annotations

import numpy as np
import pytest
from kernels_kit import View, rays_only

from farpoint._kernels.repeated import OTHERS, SURE, beyond_chance
from farpoint.geometry import sphere

WITHIN = 0.02  # rad, since the noise of `rays_only` is one
AHEAD, ASIDE = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])


def rays(rng: np.random.Generator, count: int, height: float) -> np.ndarray:
    """Of an image twice as wide as its distance, and so high."""
    x, y = rng.uniform(-1.0, 1.0, count), height * rng.uniform(-1.0, 1.0, count)
    return sphere.normalize(np.c_[x, y, np.ones(count)])


def anywhere(seed: int, count: int, height: float) -> View:
    rng = np.random.default_rng(seed)
    return rays_only(rays(rng, count, height), rays(rng, count, height))


def told(view: View, t: np.ndarray, right: np.ndarray | None = None) -> float:
    right = np.zeros(view.size) if right is None else right
    return beyond_chance(view.pairs, right, np.eye(3), t, WITHIN)


@pytest.mark.parametrize("height", [0.05, 0.3, 0.8])
@pytest.mark.parametrize("t", [AHEAD, ASIDE], ids=["ahead", "aside"])
def test_wrong_matches_anywhere_lie_there_by_chance(t, height):
    found = [told(anywhere(seed, 200, height), t) for seed in range(100)]
    assert max(found) < 10.0
    assert np.mean(found) < 0.0


def test_those_about_their_lines_are_counted_but_for_chance():
    rng = np.random.default_rng(3)
    view = anywhere(3, 200, 0.8)
    on_line = view.rays0 + ASIDE * rng.uniform(-0.5, 0.5, (200, 1))
    repeated = np.arange(200) < 60
    shifted = sphere.normalize(np.where(repeated[:, None], on_line, view.rays1))
    found = told(rays_only(view.rays0, shifted), ASIDE)
    assert 35.0 < found < 60.0
    right = repeated.astype(float)  # then these are not wrong
    assert told(rays_only(view.rays0, shifted), ASIDE, right) < 10.0


def test_it_is_the_count_of_a_plain_loop():
    view, right = anywhere(5, 60, 0.3), np.random.default_rng(5).uniform(size=60)
    t = sphere.normalize(np.array([0.5, -0.2, 0.8]))
    a, b = view.rays0[right < 0.5], view.rays1[right < 0.5]

    def count(shift: int) -> int:
        m, c = a, np.roll(b, -shift, axis=0)
        n, q = np.cross(t, m), np.cross(c, t)
        off = np.sum(c * n, axis=1) / np.sqrt(np.sum(n * n, axis=1) + np.sum(q * q, axis=1))
        return np.count_nonzero(np.abs(off) < WITHIN)

    chance = np.mean([count(k * len(a) // (OTHERS + 1)) for k in range(1, OTHERS + 1)])
    assert told(view, t, right) == pytest.approx(count(0) - chance - SURE * np.sqrt(chance))


@pytest.mark.parametrize("count", [1, 2, 20])
def test_few_or_none_wrong_are_none(count):
    view = anywhere(1, count, 0.3)
    assert told(view, AHEAD, np.ones(count)) == 0.0
    assert told(view, AHEAD) < 10.0
