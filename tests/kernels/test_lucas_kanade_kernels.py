"""Windows tracked from image to image: a known shift is found, and failures are reported."""

from __future__ import annotations

import numpy as np
import pytest

from farpoint.tracks.kernels.lucas_kanade import Levels, blank_workspace, border_px, follow_windows
from farpoint.tracks.kernels.windows import Termination

HALF = 4
BORDER = border_px(HALF)
SIZE = (48, 40)  # width, height
SHIFT = np.array([1.37, -0.81])


def picture(shift: np.ndarray) -> np.ndarray:
    """A smooth texture moved by ``shift``, exact at the centres of the pixels."""
    x, y = np.meshgrid(np.arange(SIZE[0]) - shift[0], np.arange(SIZE[1]) - shift[1])
    grey = 128 + 50 * np.sin(0.5 * x + 0.2 * y) + 50 * np.cos(0.25 * x - 0.45 * y)
    return np.rint(grey).astype(np.uint8)


def single_level(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A pyramid of one level, and its layout."""
    whole = np.pad(image, BORDER, mode="edge")
    height, width = image.shape
    line = whole.shape[1]
    return whole.ravel(), np.array([[BORDER * (line + 1), line, width, height]])


def refine_if_competitive(image0: np.ndarray, image1: np.ndarray, points: np.ndarray) -> np.ndarray:
    values0, layout = single_level(image0)
    values1, _ = single_level(image1)
    found = np.empty(points.shape)
    levels0, levels1 = Levels(values0, layout), Levels(values1, layout)
    space = blank_workspace(HALF)
    follow_windows(levels0, levels1, points, points, Termination(20, 0.01), 1.0, space, found)
    return found


def test_a_shift_is_found_to_a_fiftieth_of_a_pixel():
    points = np.random.default_rng(0).uniform([6, 6], np.array(SIZE) - 8, (12, 2))
    found = refine_if_competitive(picture(np.zeros(2)), picture(SHIFT), points)
    np.testing.assert_allclose(found - points, np.tile(SHIFT, (12, 1)), rtol=0.0, atol=0.02)


@pytest.mark.parametrize("corner", [(0.0, 0.0), (47.0, 39.0), (0.0, 39.0)])
def test_windows_reach_beyond_the_border(corner):
    still = picture(np.zeros(2))
    np.testing.assert_allclose(
        refine_if_competitive(still, still, np.array([corner]))[0], corner, atol=0.01
    )


def test_what_has_no_texture_or_leaves_the_image_is_not_found():
    points = np.array([[20.0, 20.0], [1.0, 20.0], [np.nan, 20.0]])
    flat = np.full((SIZE[1], SIZE[0]), 90, np.uint8)
    assert np.isnan(refine_if_competitive(flat, flat, points)).all()
    moved = refine_if_competitive(picture(np.zeros(2)), picture(np.array([-3.0, 0.0])), points)
    assert np.isnan(moved).any(axis=1).tolist() == [False, True, True]


@pytest.mark.parametrize("slope", [-1, 1])
def test_stripes_of_one_direction_are_not_found(slope):
    x, y = np.meshgrid(*map(np.arange, SIZE))
    stripes = np.rint(128 + 120 * np.sin(0.8 * (x + slope * y))).astype(np.uint8)
    # One grey level beside the window is all that fixes the position along a stripe.
    stripes[20, 20 + HALF + 1] ^= 1
    assert np.isnan(refine_if_competitive(stripes, stripes, np.array([[20.0, 20.0]]))).all()
