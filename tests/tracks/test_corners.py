"""Corners: where they lie, and that they cover the image."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from tracks_textures import Waves, photo

from farpoint.tracks import CornerOptions
from farpoint.tracks.corners import find_corners, thin_out

NONE = np.empty((0, 2))
OPTIONS = CornerOptions(cell_px=40)


@pytest.fixture(scope="module")
def image() -> np.ndarray:
    return photo(Waves(1, shape=(240, 320)).grey())


def distances(points: np.ndarray) -> np.ndarray:
    apart = np.abs(points[:, None] - points[None]).max(axis=2)
    return apart[~np.eye(len(points), dtype=bool)]


def test_every_corner_is_a_local_maximum_of_opencvs_measure(image):
    corners = find_corners(image, NONE, 200, 10, OPTIONS)
    strength = cv2.cornerMinEigenVal(image, OPTIONS.block_px, ksize=3)
    for x, y in corners.astype(int):
        assert strength[y, x] == pytest.approx(
            strength[y - 4 : y + 5, x - 4 : x + 5].max(), rel=1e-4
        )


def test_corners_cover_all_cells_evenly(image):
    corners = find_corners(image, NONE, 96, 2, OPTIONS)
    bins = {"bins": (6, 8), "range": ((0, 240), (0, 320))}
    counts, _, _ = np.histogram2d(corners[:, 1], corners[:, 0], **bins)
    assert len(corners) == 96
    assert counts.min() >= 1
    assert counts.max() <= 3


def test_new_corners_go_to_the_cells_that_hold_fewest(image):
    existing = find_corners(image, NONE, 96, 10, OPTIONS)
    # Two in nearly every cell of the left half, which offers more corners.
    existing = existing[existing[:, 0] < 160]
    assert len(find_corners(image, existing, 1000, 10, OPTIONS)) > 150
    new = find_corners(image, existing, 40, 10, OPTIONS)
    assert len(new) == 40
    assert np.mean(new[:, 0] >= 159) >= 0.9


def test_corners_keep_their_distances(image):
    old = np.array([[100.4, 90.6], [30.0, 200.0], [104.0, 92.0], [0.0, 0.0], [319.0, 239.0]])
    new = find_corners(image, old, 1000, 11, OPTIONS)
    assert len(new) > 200
    assert distances(new).min() >= OPTIONS.min_distance_px
    assert np.abs(new[:, None] - np.rint(old)).max(axis=2).min() >= OPTIONS.min_distance_px
    assert new.min() >= 11
    assert new[:, 0].max() <= 319 - 11
    assert new[:, 1].max() <= 239 - 11


def test_masked_corners_are_not_taken(image):
    mask = np.zeros(image.shape, bool)
    mask[50:120, 200:300] = True
    corners = find_corners(image, NONE, 500, 2, OPTIONS, mask).astype(int)
    assert len(corners) > 20
    assert mask[corners[:, 1], corners[:, 0]].all()


@pytest.mark.parametrize(("min_slope", "found"), [(9.0, True), (12.0, False)])
def test_strength_is_the_slope_in_grey_levels_per_pixel(min_slope, found):
    y, x = np.mgrid[:256, :256]
    amplitude, period = 40, 16
    waves = 128 + amplitude * (np.cos(2 * np.pi * x / period) + np.cos(2 * np.pi * y / period))
    # Over a whole period the mean square slope along x, and along y, by Sobel's differences.
    slope = amplitude * np.sin(2 * np.pi / period) / np.sqrt(2)
    assert 9.0 < slope < 12.0
    options = CornerOptions(block_px=period, min_slope=min_slope)
    corners = find_corners(np.rint(waves).astype(np.uint8), NONE, 50, 20, options)
    assert (len(corners) > 0) == found


@pytest.mark.parametrize("size", [(1, 1), (3, 40), (240, 320)])
@pytest.mark.parametrize("grey", [0, 255])
def test_featureless_images_have_no_corners(size, grey):
    assert find_corners(np.full(size, grey, np.uint8), NONE, 100, 2, OPTIONS).shape == (0, 2)


def test_noise_alone_is_no_corner():
    noise = np.random.default_rng(0).normal(100, 1.5, (240, 320))
    assert len(find_corners(np.rint(noise).astype(np.uint8), NONE, 100, 2, OPTIONS)) == 0


def test_thinning_keeps_the_first_of_points_that_meet():
    points = np.array([[5.0, 5.0], [7.0, 5.0], [5.0, 9.0], [0.0, 0.0]])
    occupied = np.zeros((12, 12), bool)
    assert thin_out(points, occupied, 2).tolist() == [0, 2, 3]
    assert thin_out(points, occupied, 2).tolist() == []
