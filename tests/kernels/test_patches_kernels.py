"""The image in patches, held against the same written down plainly."""

from __future__ import annotations

import numpy as np
import pytest

from farpoint._kernels.patches import split_image
from farpoint.geometry import sphere


def patches(rays: np.ndarray, splits: int) -> np.ndarray:
    patch = np.empty(len(rays), np.int64)
    split_image(np.ascontiguousarray(rays).reshape(-1), splits, patch)
    return patch


def plainly(rays: np.ndarray, splits: int) -> list[np.ndarray]:
    """The rows of each patch."""
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
    found = patches(rays, splits)
    assert set(map(tuple, plainly(rays, splits))) == {
        tuple(np.flatnonzero(found == k)) for k in np.unique(found)
    }


def test_rays_all_around_lie_together_in_their_patch():
    rays = sphere.normalize(np.random.default_rng(2).normal(size=(640, 3)))
    found = patches(rays, 7)
    assert np.bincount(found).max() < 15
    within = [sphere.angle_between(rays[found == k][0], rays[found == k]).max() for k in set(found)]
    assert np.median(within) < 0.4


def test_rays_that_are_all_alike_are_one_patch():
    assert set(patches(np.tile(ahead(3, 1), (50, 1)), 5)) == {0}
