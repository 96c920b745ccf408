"""The height over the ground that is in view."""

from __future__ import annotations

import numpy as np
import pytest
from aiding_kit import CAMERA

from farpoint import OdometryResult, Tracks, estimate_relative_pose
from farpoint.aiding import CameraHeight, MetricScale
from farpoint.aiding.ground import find_ground
from farpoint.geometry import so3

STEP = 0.8


def seen(
    height: float = 1.6,
    pitch: float = 0.03,
    ground: int = 150,
    clutter: int = 100,
    frame: int = 1,
    unit: float = 1.0,
) -> OdometryResult:
    """A motion over a road with things beside it, in a unit of ``unit`` metres."""
    rng = np.random.default_rng(frame)
    count = ground + clutter
    X = np.column_stack(
        [rng.uniform(-6, 6, count), np.full(count, height), rng.uniform(2.0, 20.0, count)]
    )
    X[ground:, 1] = rng.uniform(-3.0, height, clutter)
    far = 40.0 * rng.normal(size=(60, 3)) + [0.0, -5.0, 120.0]
    tilt = so3.exp([pitch, 0.0, 0.0])
    X = np.vstack([X, far]) @ tilt.T
    pixels0, pixels1 = CAMERA.project(X), CAMERA.project(X - STEP * tilt[:, 2])
    inside = np.isfinite(pixels0 + pixels1).all(axis=1)
    inside &= (np.abs(pixels1 - [320, 240]) < [320, 240]).all(axis=1)
    points0, points1 = pixels0[inside], pixels1[inside]
    points1 = points1 + 0.1 * rng.normal(size=points1.shape)
    covariance = np.tile(0.01 * np.eye(2), (len(points0), 1, 1))
    pose = estimate_relative_pose(points0, points1, CAMERA)
    return OdometryResult(
        frame0=frame - 1,
        frame1=frame,
        timestamp0=0.1 * frame - 0.1,
        timestamp=0.1 * frame,
        pose=pose,
        tracks=Tracks(
            ids=np.arange(len(points0)), points0=points0, points1=points1, covariance_px2=covariance
        ),
        world_from_cam=np.eye(4),
        world_covariance=np.zeros((7, 7)),
        scale=STEP / unit,
        scale_sigma=0.0,
    )


@pytest.mark.parametrize("pitch", [-0.05, 0.0, 0.05])
@pytest.mark.parametrize("height", [0.9, 1.6])
def test_the_height_is_found_among_other_things(height, pitch):
    assert find_ground(CAMERA, seen(height, pitch)) == pytest.approx(height, rel=0.04)


def test_no_ground_no_height():
    assert find_ground(CAMERA, seen(ground=5, clutter=15)) is None
    assert find_ground(CAMERA, seen(ground=4, clutter=400)) is None


def test_a_known_height_brings_metres():
    scale = MetricScale([CameraHeight(height_m=1.6, sigma=0.03)])
    for frame in range(1, 26):
        now = scale.add(CAMERA, seen(frame=frame, unit=2.5))
    assert now.metres_per_unit == pytest.approx(2.5, rel=0.04)
    assert 0.03 < now.sigma < 0.08
