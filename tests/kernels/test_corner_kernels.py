"""Corner strength against plain NumPy, and local maxima against exhaustive search."""

from __future__ import annotations

import numpy as np
import pytest

from farpoint.tracks.kernels.corners import corner_strength, strongest_places

IMAGE = np.random.default_rng(0).integers(0, 256, (23, 31)).astype(np.uint8)


def strength_slowly(image: np.ndarray, block: int) -> np.ndarray:
    """Smallest eigenvalue of the mean of gradient products, block by block."""
    grey = image.astype(float)
    sobel = np.array([[1, 2, 1]])
    along = np.array([[-1, 0, 1]])
    height, width = image.shape
    gradients = np.zeros((height, width, 2))
    for y in range(1, height - 1):
        for x in range(1, width - 1):
            patch = grey[y - 1 : y + 2, x - 1 : x + 2]
            gradients[y, x] = np.sum(patch * sobel.T * along), np.sum(patch * along.T * sobel)
    gradients /= 8.0
    strength = np.zeros(image.shape)
    before, after = block // 2, block - block // 2
    for y in range(1 + before, height - after):
        for x in range(1 + before, width - after):
            g = gradients[y - before : y + after, x - before : x + after].reshape(-1, 2)
            strength[y, x] = np.linalg.eigvalsh(g.T @ g / block**2)[0]
    return strength


@pytest.mark.parametrize("block", [2, 5, 7])
def test_strength_is_the_mean_square_slope_in_the_weakest_direction(block):
    strength = np.empty(IMAGE.shape, np.float32)
    corner_strength(IMAGE, block, strength)
    np.testing.assert_allclose(strength, strength_slowly(IMAGE, block), rtol=1e-4, atol=1e-2)


@pytest.mark.parametrize("shape", [(1, 1), (3, 40), (40, 3), (8, 8)])
def test_images_that_hold_no_block_have_no_strength(shape):
    strength = np.full(shape, np.nan, np.float32)
    corner_strength(np.arange(np.prod(shape)).reshape(shape).astype(np.uint8), 7, strength)
    np.testing.assert_array_equal(strength, 0.0)


@pytest.mark.parametrize("reach", [1, 4])
def test_places_are_those_that_looking_everywhere_would_find(reach):
    rng = np.random.default_rng(1)
    strength = rng.permutation(25 * 37).reshape(25, 37).astype(np.float32)
    taken = rng.random(strength.shape) < 0.2
    border, least = 3, 400.0
    expected = []
    for y in range(border, 25 - border):
        for x in range(border, 37 - border):
            around = strength[max(y - reach, 0) : y + reach + 1, max(x - reach, 0) : x + reach + 1]
            if strength[y, x] == around.max() and strength[y, x] > least and not taken[y, x]:
                expected.append((x, y))
    places = np.empty((25 * 37, 2), np.int64)
    count = strongest_places(strength, least, reach, border, taken, places)
    assert len(expected) > 3
    assert sorted(map(tuple, places[:count].tolist())) == sorted(expected)
