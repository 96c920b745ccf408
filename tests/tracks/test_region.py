"""Tracks of a wide lens: within its field, and not on its rim."""

from __future__ import annotations

import numpy as np
import pytest
from tracks_textures import Waves, photo

from farpoint.camera import Camera, Equirectangular, Unified, valid_region
from farpoint.tracks import Tracker, TrackerOptions, trackable_region
from farpoint.tracks.refinement import window_reach

OPTIONS = TrackerOptions(max_tracks=200)
REACH = window_reach(OPTIONS.refinement)
# Sees to 131.8 degrees off the axis, in a circle of about 107 px.
FISHEYE = Camera(model=Unified(fx=120.0, fy=120.0, cx=160.0, cy=120.0, xi=1.5), size=(321, 243))


def pictured(camera: Camera, shift: tuple[float, float]) -> np.ndarray:
    """A texture that moves behind a circle that does not; black around it."""
    assert camera.size is not None
    image = photo(Waves(4, shape=camera.size[::-1]).grey(shift=shift))
    return np.where(valid_region(camera), image, 0).astype(np.uint8)


def test_every_window_lies_in_the_field_and_few_pixels_are_given_away():
    region = trackable_region(FISHEYE, OPTIONS)
    assert region is not None
    assert region.shape == (243, 321)
    valid = valid_region(FISHEYE)
    rows, columns = np.nonzero(region)
    for down in (-REACH, 0, REACH):
        for right in (-REACH, 0, REACH):
            row, column = rows + down, columns + right
            inside = (row >= 0) & (row < 243) & (column >= 0) & (column < 321)
            assert valid[row[inside], column[inside]].all()
    away = np.hypot(*np.meshgrid(np.arange(321) - 160.0, np.arange(243) - 120.0))
    rim = away[valid].max()
    assert region[away < rim - 2.5 * REACH].all()


@pytest.mark.parametrize(
    "camera",
    [
        Camera.pinhole(640, 480, 500.0, 500.0, 319.5, 239.5),
        Camera(model=Equirectangular(width=400, height=200), size=(400, 200)),
    ],
    ids=["pinhole", "360"],
)
def test_a_lens_that_fills_its_image_needs_no_region(camera):
    assert trackable_region(camera) is None


def test_no_track_begins_at_the_rim_or_goes_on_there():
    region = trackable_region(FISHEYE, OPTIONS)
    assert region is not None
    tracker = Tracker(OPTIONS, mask=region)
    images = [pictured(FISHEYE, (0.0, 0.0)), pictured(FISHEYE, (6.0, -3.0))]
    tracker.restart(images[0])
    tracks = tracker.match(images[1])
    assert len(tracks) > 60
    np.testing.assert_allclose(
        tracks.points1 - tracks.points0, np.broadcast_to([6.0, -3.0], (len(tracks), 2)), atol=0.3
    )
    for points in (tracker.points, tracks.points1):
        column, row = np.rint(points).astype(int).T
        assert region[row, column].all()
    without = Tracker(OPTIONS)
    without.restart(images[0])
    flow = np.subtract(*(getattr(without.match(images[1]), n) for n in ("points1", "points0")))
    assert (np.abs(flow - [6.0, -3.0]).max(axis=1) > 2.0).sum() > 5  # what the rim would do
