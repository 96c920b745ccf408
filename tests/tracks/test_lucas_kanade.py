"""Pyramids and the points followed by them, beside OpenCV's."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from tracks_textures import Waves, photo

from farpoint.tracks import LucasKanadeOptions
from farpoint.tracks.lucas_kanade import track_points
from farpoint.tracks.pyramid import Pyramid, build_pyramid

OPTIONS = LucasKanadeOptions()
SCENE = Waves(3, shape=(240, 320))
SHIFT = (6.4, -3.7)
STILL, MOVED = photo(SCENE.grey()), photo(SCENE.grey(shift=SHIFT))
POINTS = np.random.default_rng(0).uniform([25, 25], [295, 215], (200, 2))


def level(pyramid: Pyramid, k: int) -> np.ndarray:
    place, line, width, height = pyramid.layout[k]
    rows = place + line * np.arange(height)
    return pyramid.values[rows[:, None] + np.arange(width)]


def opencv(start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where OpenCV's Lucas-Kanade finds the points, and whether it does."""
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, OPTIONS.max_iterations, 0.03)
    found, status, _ = cv2.calcOpticalFlowPyrLK(
        STILL,
        MOVED,
        POINTS.astype(np.float32),
        start.astype(np.float32),
        winSize=(OPTIONS.window_px, OPTIONS.window_px),
        maxLevel=OPTIONS.levels,
        criteria=criteria,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return found.astype(float), status.ravel() == 1


def followed(start: np.ndarray, moved: np.ndarray = MOVED) -> tuple[np.ndarray, np.ndarray]:
    still, other = build_pyramid(STILL, OPTIONS), build_pyramid(moved, OPTIONS)
    return track_points(still, other, POINTS, start, OPTIONS)


def test_levels_are_opencvs_and_their_borders_repeat_what_is_within():
    pyramid = build_pyramid(STILL, LucasKanadeOptions(levels=9))
    expected = STILL
    for k in range(len(pyramid.layout)):
        np.testing.assert_array_equal(level(pyramid, k), expected)
        expected = cv2.pyrDown(expected)
    assert len(pyramid.layout) == 5  # no window fits into half of 15 px
    place, line, width, _ = pyramid.layout[0]
    np.testing.assert_array_equal(pyramid.values[place - 9 : place], STILL[0, 0])
    np.testing.assert_array_equal(pyramid.values[place - line :][:width], STILL[0])


def test_points_are_found_where_opencv_finds_them():
    ours, found = followed(POINTS)
    theirs, seen = opencv(POINTS)
    assert found.mean() > 0.95
    assert seen[found].all()
    assert np.linalg.norm(ours - theirs, axis=1)[found].max() < 0.05


@pytest.mark.parametrize(("gain", "offset"), [(0.6, 0.0), (1.4, -30.0), (0.8, 40.0)])
def test_a_change_of_exposure_moves_no_point(gain, offset):
    moved = photo(gain * (SCENE.grey(shift=SHIFT) - 128) + 128 + offset)
    ours, found = followed(POINTS, moved=moved)
    assert found.mean() > 0.95
    assert np.quantile(np.abs(ours - POINTS - SHIFT)[found], 0.95) < 0.1


def test_points_expected_near_the_truth_are_found_as_well():
    rng = np.random.default_rng(1)
    ours, found = followed(POINTS + SHIFT + rng.normal(0, 0.3, POINTS.shape))
    assert found.mean() > 0.99
    np.testing.assert_allclose((ours - POINTS)[found], np.tile(SHIFT, (found.sum(), 1)), atol=0.1)


def test_a_few_bad_expectations_cost_no_other_point():
    start = POINTS + SHIFT
    start[5:15] += 300.0
    _, found = followed(start)
    assert np.delete(found, np.s_[5:15]).mean() > 0.99
