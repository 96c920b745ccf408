"""Parts of the image and their halves, against a reference in plain NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from farpoint._kernels.image_parts import split_image, split_parts
from farpoint._kernels.linear import draw_index
from farpoint.geometry import sphere


def parts(rays: np.ndarray, splits: int) -> np.ndarray:
    part = np.empty(len(rays), np.int64)
    split_image(np.ascontiguousarray(rays).reshape(-1), splits, part)
    return part


def plainly(rays: np.ndarray, splits: int) -> list[np.ndarray]:
    """The rows of each part."""
    parts = [np.arange(len(rays))]
    for _ in range(splits):
        halves = []
        for part in parts:
            if len(part) == 0:
                continue
            along = rays[part, np.argmax(np.var(rays[part], axis=0))]
            halves += [part[along <= along.mean()], part[along > along.mean()]]
        parts = halves
    return [part for part in parts if len(part)]


def ahead(seed: int, count: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return sphere.normalize(np.c_[rng.uniform(-1.0, 1.0, (count, 2)), np.ones(count)])


@pytest.mark.parametrize("splits", [0, 1, 4, 6])
@pytest.mark.parametrize("count", [1, 7, 300])
def test_each_part_is_split_across_its_longest_axis(splits, count):
    rays = ahead(1, count)
    found = parts(rays, splits)
    assert set(map(tuple, plainly(rays, splits))) == {
        tuple(np.flatnonzero(found == k)) for k in np.unique(found)
    }


def test_rays_all_around_lie_together_in_their_part():
    rays = sphere.normalize(np.random.default_rng(2).normal(size=(640, 3)))
    found = parts(rays, 7)
    assert np.bincount(found).max() < 15
    within = [sphere.angle_between(rays[found == k][0], rays[found == k]).max() for k in set(found)]
    assert np.median(within) < 0.4


def test_equal_rays_are_one_part():
    assert set(parts(np.tile(ahead(3, 1), (50, 1)), 5)) == {0}


def chosen(part: np.ndarray, state: np.ndarray) -> np.ndarray:
    """Half of each row: parts in random order, each to the smaller half."""
    sizes, half, order = [0, 0], np.empty(len(part), np.int64), np.arange(part.max() + 1)
    for i in range(len(order)):  # Fisher and Yates
        j = i + draw_index(state, len(order) - i)
        order[[i, j]] = order[[j, i]]
        smaller = int(sizes[0] > sizes[1])
        sizes[smaller] += np.count_nonzero(part == order[i])
        half[part == order[i]] = smaller
    return half


@pytest.mark.parametrize("parts", [1, 2, 7, 200])
def test_whole_parts_go_to_the_smaller_half(parts):
    part = np.random.default_rng(1).integers(0, parts, 200)
    state, again = np.zeros(1, np.uint64), np.zeros(1, np.uint64)
    splits = []
    for _ in range(3):
        half = np.empty(200, np.int64)
        first = split_parts(part, state, half)
        np.testing.assert_array_equal(half, chosen(part, again))
        assert first == np.count_nonzero(half == 0)
        assert abs(first - (200 - first)) <= np.bincount(part).max()
        splits.append(half)
    assert np.array_equal(state, again)
    assert (parts < 3) == bool(np.all(splits[0] == splits[1]) or np.all(splits[0] != splits[1]))


def test_every_match_comes_into_either_half_as_often():
    state, times = np.zeros(1, np.uint64), np.zeros(31)
    for _ in range(2000):
        half = np.empty(31, np.int64)
        split_parts(np.arange(31), state, half)
        assert np.count_nonzero(half == 0) == 16
        times += half == 0
    # 16 of 31 splits; the standard deviation of the share is 0.011.
    np.testing.assert_allclose(times / 2000.0, 16.0 / 31.0, atol=0.05)
