"""Rows and exposures of rendered images are those of images rendered at their own times."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from farpoint.camera import Camera
from farpoint.camera.equirectangular import Equirectangular
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.errors import InputError
from farpoint.synthetic import (
    ImagingOptions,
    Miscalibration,
    RenderedSequence,
    SmoothMotion,
    handheld_walk,
    standing_still,
    street_drive,
)
from farpoint.trajectory.files import Trajectory

PINHOLE = Camera.pinhole(160, 120, 120, 120, 79.5, 59.5)
FISHEYE = Camera(model=KannalaBrandt(fx=60, fy=60, cx=79.5, cy=59.5, k1=0.02), size=(160, 120))
SPHERE = Camera(model=Equirectangular(width=160, height=80), size=(160, 80))
CLEAN = ImagingOptions(noise_grey=0.0)
ROLLING = ImagingOptions(noise_grey=0.0, readout_s=0.025)
WALK = handheld_walk(6, seed=2)
FRAME = 3


def image(sequence: RenderedSequence, index: int) -> np.ndarray:
    found = sequence.view(index).frame.image
    assert found is not None
    return found


def at_time(camera: Camera, time_s: float, world: RenderedSequence) -> RenderedSequence:
    """A global shutter in the same town, at a time between the frames of the walk."""
    pose = SmoothMotion(WALK).poses(np.array([time_s]))
    path = Trajectory(timestamps=np.array([time_s]), world_from_body=pose)
    sequence = RenderedSequence(camera, path, imaging=CLEAN)
    sequence._scene = world._scene
    return sequence


@pytest.mark.parametrize("camera", [PINHOLE, FISHEYE, SPHERE], ids=["pinhole", "fisheye", "360"])
def test_a_row_is_that_of_an_image_taken_at_its_time(camera: Camera):
    rolling = RenderedSequence(camera, WALK, imaging=ROLLING)
    taken, depth = image(rolling, FRAME), rolling.view(FRAME).depth
    height = taken.shape[0]
    for row in (0, height // 3, height - 1):
        late = ROLLING.readout_s * (row / (height - 1) - 0.5)
        expected = at_time(camera, WALK.timestamps[FRAME] + late, rolling).view(0)
        assert expected.frame.image is not None
        np.testing.assert_array_equal(depth[row], expected.depth[row])
        # Edges are looked for in neighbouring rows, which are read at other times.
        same = taken[row] == expected.frame.image[row]
        assert same.mean() > 0.98
    # The test can fail: taken at one time, the image is another one, but in the middle.
    instant = image(RenderedSequence(camera, WALK, imaging=CLEAN), FRAME)
    assert np.mean(instant == taken) < 0.8
    middle = slice(height // 2 - 1, height // 2 + 1)
    assert np.mean(np.abs(instant[middle].astype(int) - taken[middle]) <= 1) > 0.95


def test_a_camera_that_stands_takes_the_same_image_with_any_shutter():
    path = standing_still(3)
    slow = ImagingOptions(readout_s=0.03, exposure_s=0.01)
    instant = RenderedSequence(PINHOLE, path, seed=5)
    found = image(RenderedSequence(PINHOLE, path, seed=5, imaging=slow), 1)
    assert np.mean(found == image(instant, 1)) > 0.999  # rounding of the mean


def test_no_read_out_and_no_exposure_is_what_was_rendered_without_the_options():
    path = street_drive(3, seed=4)
    timed = ImagingOptions(readout_s=0.0, exposure_s=0.0, exposure_samples=9)
    found = image(RenderedSequence(PINHOLE, path, seed=4, imaging=timed), 2)
    np.testing.assert_array_equal(found, image(RenderedSequence(PINHOLE, path, seed=4), 2))


def test_a_blurred_image_is_the_mean_over_its_exposure():
    blurred = ImagingOptions(noise_grey=0.0, exposure_s=0.02, exposure_samples=3)
    sequence = RenderedSequence(FISHEYE, WALK, imaging=blurred)
    times = WALK.timestamps[FRAME] + 0.02 * np.array([-1.0, 0.0, 1.0]) / 3.0
    sharp = [image(at_time(FISHEYE, time, sequence), 0).astype(float) for time in times]
    taken = image(sequence, FRAME)
    # Each of the sharp ones was rounded.
    assert np.abs(taken - np.mean(sharp, axis=0)).max() <= 1.0
    assert np.abs(taken - sharp[1]).max() > 5.0
    depth = at_time(FISHEYE, WALK.timestamps[FRAME], sequence).view(0).depth
    np.testing.assert_allclose(sequence.view(FRAME).depth, depth, rtol=1e-9)


@pytest.mark.parametrize("camera", [PINHOLE, FISHEYE, SPHERE], ids=["pinhole", "fisheye", "360"])
def test_points_are_transferred_to_the_row_that_sees_them(camera: Camera):
    sequence = RenderedSequence(camera, WALK, imaging=ROLLING)
    assert camera.size is not None
    points0 = np.random.default_rng(1).uniform(0, np.array(camera.size) - 1, (800, 2))
    points1 = sequence.transfer(points0, 1, 4)
    seen = np.isfinite(points1).all(axis=1)
    assert seen.mean() > 0.5
    back = sequence.transfer(points1[seen], 4, 1)
    again = np.isfinite(back).all(axis=1)
    assert again.mean() > 0.98
    np.testing.assert_allclose(back[again], points0[seen][again], atol=1e-4)
    # In the world: the same point along both rays, each from where its row was read.
    late = ROLLING.row_delays_s(points1[seen][:, 1], camera.size[1])
    poses = SmoothMotion(WALK).poses(WALK.timestamps[4] + late)
    rays, far = camera.unproject(points1[seen]), sequence.distances(4, points1[seen])
    there = poses[:, :3, 3] + far[:, None] * np.einsum("nij,nj->ni", poses[:, :3, :3], rays)
    late = ROLLING.row_delays_s(points0[seen][:, 1], camera.size[1])
    poses = SmoothMotion(WALK).poses(WALK.timestamps[1] + late)
    rays, far = camera.unproject(points0[seen]), sequence.distances(1, points0[seen])
    here = poses[:, :3, 3] + far[:, None] * np.einsum("nij,nj->ni", poses[:, :3, :3], rays)
    near = np.isfinite(far) & (far < 30.0)
    assert near.sum() > 100
    off = np.linalg.norm(here[near] - there[near], axis=1)
    assert np.mean(off < 1e-3 * far[near]) > 0.98


def test_the_motion_goes_through_the_poses_and_is_smooth():
    motion = SmoothMotion(WALK)
    np.testing.assert_allclose(motion.poses(WALK.timestamps), WALK.world_from_body, atol=1e-12)
    fine = np.linspace(0.0, WALK.timestamps[-1], 400)
    way = motion.poses(fine)[:, :3, 3]
    assert np.linalg.norm(np.diff(way, 3, axis=0), axis=1).max() < 1e-5
    alone = Trajectory(timestamps=WALK.timestamps[:1], world_from_body=WALK.world_from_body[:1])
    np.testing.assert_array_equal(
        SmoothMotion(alone).poses(np.array([0.0, 7.0]))[1], WALK.world_from_body[0]
    )


def test_a_motion_in_absolute_time_is_the_same():
    later = replace(WALK, timestamps=WALK.timestamps + 1.7e9)
    np.testing.assert_allclose(
        SmoothMotion(later).poses(np.array([1.7e9 + 0.0625])),
        SmoothMotion(WALK).poses(np.array([0.0625])),
        atol=1e-7,  # the clock counts 0.24 us
    )


@pytest.mark.parametrize(
    ("field", "make"),
    [
        ("readout_s", lambda: ImagingOptions(readout_s=-0.01)),
        ("exposure_s", lambda: ImagingOptions(exposure_s=2.0)),
        ("exposure_samples", lambda: ImagingOptions(exposure_samples=4)),
        ("exposure_samples", lambda: ImagingOptions(exposure_samples=0)),
        (
            "given",
            lambda: RenderedSequence(PINHOLE, WALK, given=Camera.pinhole(80, 60, 60, 60, 40, 30)),
        ),
        (
            "path",
            lambda: RenderedSequence(
                PINHOLE,
                replace(WALK, timestamps=np.zeros(len(WALK))),
                imaging=ROLLING,
            ),
        ),
        ("camera", lambda: Miscalibration(focal_share=0.1).of(SPHERE)),
    ],
)
def test_what_cannot_be_rendered_says_why(field, make):
    with pytest.raises(InputError) as error:
        make()
    assert error.value.field == field
