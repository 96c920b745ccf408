"""A mask keeps tracks off what moves with the camera: a bonnet over the lower third of a drive."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from farpoint import Camera, Odometry, OdometryOptions, PoseStatus
from farpoint.errors import InputError
from farpoint.geometry import sphere
from farpoint.synthetic import render_drive
from farpoint.tracks import TrackerOptions, unmasked_region
from farpoint.tracks.refinement import window_reach

WIDTH, HEIGHT = 320, 240
CAMERA = Camera.pinhole(WIDTH, HEIGHT, 250.0, 250.0, 159.5, 119.5)
DRIVE = render_drive(CAMERA, frames=8, fps=10.0, seed=5)
TOP = HEIGHT * 2 // 3  # of the bonnet
MASK = np.broadcast_to(np.arange(HEIGHT)[:, None] < TOP, (HEIGHT, WIDTH)).copy()
OPTIONS = OdometryOptions(tracker=TrackerOptions(max_tracks=300))
REACH = window_reach(OPTIONS.tracker.refinement)


def covered(image: np.ndarray) -> np.ndarray:
    """The image behind a bonnet with a strong texture, which stands still."""
    noise = np.random.default_rng(1).normal(size=(HEIGHT - TOP, WIDTH))
    texture = cv2.GaussianBlur(noise, (0, 0), 1.5)
    result = image.copy()
    result[TOP:] = np.clip(128 + 50 * texture / texture.std(), 0, 255)
    return result


def run(mask: np.ndarray | None) -> list:
    odometry = Odometry(CAMERA, OPTIONS, mask=mask)
    results = [odometry.process(covered(f.image), f.timestamp) for f in DRIVE]
    return results[1:]


def heading_errors_deg(results: list) -> list[float]:
    errors = []
    for k, result in enumerate(results):
        true = np.linalg.inv(DRIVE.world_from_cam[k + 1]) @ DRIVE.world_from_cam[k]
        direction = result.pose.direction_cam1_from_cam0
        off = (
            math.pi
            if direction is None
            else float(sphere.angle_between(direction, sphere.normalize(true[:3, 3])))
        )
        errors.append(math.degrees(off))
    return errors


def test_nothing_is_tracked_where_the_mask_is_black():
    free, masked = run(None), run(MASK)
    assert max(np.mean(r.tracks.points1[:, 1] > TOP) for r in free) > 0.2
    for result in masked:
        assert result.pose.status is PoseStatus.OK
        for points in (result.tracks.points0, result.tracks.points1):
            assert len(points) > 60
            assert points[:, 1].max() < TOP - REACH + 0.5
    assert np.median(heading_errors_deg(masked)) < 0.2


def test_of_bytes_white_is_used():
    grey = np.where(MASK, 128, 127).astype(np.uint8)
    by_bytes, by_bool = run(grey)[-1], run(MASK)[-1]
    np.testing.assert_array_equal(by_bytes.tracks.points1, by_bool.tracks.points1)


def test_windows_keep_clear_of_a_single_black_pixel():
    mask = np.ones((60, 80), bool)
    mask[30, 40] = False
    rows, columns = np.nonzero(~unmasked_region(mask))
    assert (rows.min(), rows.max()) == (30 - REACH, 30 + REACH)
    assert (columns.min(), columns.max()) == (40 - REACH, 40 + REACH)
    assert len(rows) == (2 * REACH + 1) ** 2


@pytest.mark.parametrize(
    "mask",
    [
        np.zeros((HEIGHT, WIDTH), bool),
        np.full((HEIGHT, WIDTH), 1, np.uint8),
        np.ones((WIDTH, HEIGHT), bool),
        np.ones((HEIGHT, WIDTH)),
        np.ones((HEIGHT, WIDTH, 3), np.uint8),
        np.ones(5, bool),
    ],
)
def test_masks_that_fit_nothing_are_refused_by_name(mask):
    with pytest.raises(InputError, match="mask"):
        Odometry(CAMERA, mask=mask)


def test_what_only_the_first_frame_shows_is_refused_then():
    image = np.full((HEIGHT, WIDTH), 90, np.uint8)
    unsized = Odometry(Camera(model=CAMERA.model), mask=MASK[:-1])
    with pytest.raises(InputError, match="mask"):
        unsized.process(image, 0.0)
    specks = np.zeros((HEIGHT, WIDTH), bool)
    specks[::9, ::9] = True
    with pytest.raises(InputError, match="room"):
        Odometry(CAMERA, mask=specks).process(image, 0.0)
