"""Hot and dead pixels: found while the image moves, and only then; repaired; forgotten."""

from __future__ import annotations

import numpy as np
import pytest
from tracks_textures import Waves, photo

from farpoint.tracks import Tracker, TrackerOptions
from farpoint.tracks.defects import DefectivePixels

SCENE = Waves(7, shape=(240, 320))
OPTIONS = TrackerOptions(max_tracks=200)
RNG = np.random.default_rng(0)
# Apart from each other, so that each has a ring of its own.
PLACES = np.stack(np.meshgrid(np.arange(12, 310, 31), np.arange(12, 230, 27)), -1).reshape(-1, 2)
PLACES = PLACES + RNG.integers(-6, 7, PLACES.shape)
HALF = len(PLACES) // 2


def frame(k: float, *, step=(2.7, -1.6), defects: bool = True, blob: bool = False) -> np.ndarray:
    """A noisy scene on its way, on a sensor whose first pixels are dead, and the others hot."""
    scene = 0.4 * SCENE.grey(shift=(k * step[0], k * step[1])) + 60.0
    image = scene + np.random.default_rng(int(100 * k)).normal(0.0, 2.0, scene.shape)
    for du in (-1, 0, 1) if blob else (0,) if defects else ():
        for dv in (-1, 0, 1) if blob else (0,):
            columns, rows = (PLACES + np.array([du, dv])).T
            change = np.where(np.arange(len(PLACES)) < HALF, -90.0, 90.0)
            image[rows, columns] += change / 2.0 ** (abs(du) + abs(dv))
    return photo(image)


def tracker_after(images) -> Tracker:
    tracker = Tracker(OPTIONS)
    for image in images:
        tracker.track(image)
    return tracker


def found_by(tracker: Tracker) -> set[tuple[int, int]]:
    return set(map(tuple, tracker._defects.pixels.tolist()))


@pytest.mark.parametrize("blob", [False, True])
def test_hot_and_dead_pixels_are_found_and_nothing_else(blob):
    tracker = tracker_after(frame(k, blob=blob) for k in range(12))
    apart = np.abs(tracker._defects.pixels[:, None] - PLACES[None]).max(axis=2)
    assert np.mean(apart.min(axis=0) == 0) > 0.95
    # A blob's rim may stand out as well; no pixel that shows the scene does.
    assert apart.min(axis=1).max() <= (1 if blob else 0)


def test_a_clean_sensor_has_none():
    assert not found_by(tracker_after(frame(k, defects=False) for k in range(12)))


def test_nothing_is_learnt_while_nothing_moves():
    assert not found_by(tracker_after(frame(0.01 * k, step=(0.0, 0.0)) for k in range(12)))


def test_defects_that_are_no_more_are_forgotten():
    images = [frame(k) for k in range(8)] + [frame(k, defects=False) for k in range(8, 20)]
    assert len(found_by(tracker_after(images[:8]))) > 0.9 * len(PLACES)
    assert len(found_by(tracker_after(images))) < 0.1 * len(PLACES)


def test_repaired_images_show_the_scene_and_keep_the_rest():
    defects = tracker_after(frame(k, blob=True) for k in range(12))._defects
    given = frame(12, blob=True)
    before = given.copy()
    repaired = defects.repaired(given).astype(float)
    np.testing.assert_array_equal(given, before)
    scene = 0.4 * SCENE.grey(shift=(12 * 2.7, -12 * 1.6)) + 60.0
    columns, rows = defects.pixels.T
    for du, dv in np.ndindex(3, 3):
        at = rows + dv - 1, columns + du - 1
        assert np.abs(repaired[at] - scene[at]).mean() < 6.0
    near = np.zeros(scene.shape, bool)
    for du, dv in np.ndindex(3, 3):
        near[rows + dv - 1, columns + du - 1] = True
    np.testing.assert_array_equal(repaired[~near], given[~near])


def test_an_image_without_defects_is_handed_back_as_it_is():
    image = frame(0, defects=False)
    assert DefectivePixels().repaired(image) is image


def test_tracks_of_a_bad_sensor_follow_the_scene():
    tracker = tracker_after(frame(k) for k in range(10))
    tracks = tracker.match(frame(10))
    error = tracks.points1 - tracks.points0 - (2.7, -1.6)
    assert len(tracks) > 100
    assert np.mean(np.abs(error).max(axis=1) > 0.3) < 0.02
