"""Brightness that changes from frame to frame costs no pair and no accuracy."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from farpoint import Camera, Odometry, OdometryOptions, PoseStatus
from farpoint.geometry import so3
from farpoint.synthetic import render_drive
from farpoint.tracks import TrackerOptions

CAMERA = Camera.pinhole(320, 240, 250.0, 250.0, 159.5, 119.5)
DRIVE = render_drive(CAMERA, frames=12, fps=10.0, seed=5)
OPTIONS = OdometryOptions(tracker=TrackerOptions(max_tracks=300))
DRAWN = np.random.default_rng(3).uniform(-1.0, 1.0, 12)

Change = Callable[[int, np.ndarray], np.ndarray]


def errors_deg(change: Change) -> list[float]:
    """Rotations' errors of the pairs that are OK, with their brightness changed."""
    odometry, errors = Odometry(CAMERA, OPTIONS), []
    for k, frame in enumerate(DRIVE):
        image = np.clip(np.rint(change(k, 0.7 * frame.image)), 0, 255).astype(np.uint8)
        pose = odometry.process(image, frame.timestamp).pose
        if pose is not None and pose.status is PoseStatus.OK:
            true = np.linalg.inv(DRIVE.world_from_cam[k]) @ DRIVE.world_from_cam[k - 1]
            off = so3.angle_between(pose.rotation_cam1_from_cam0, true[:3, :3])
            errors.append(math.degrees(off))
    return errors


@cache
def steady_errors_deg() -> list[float]:
    return errors_deg(lambda _, image: image)


@pytest.mark.parametrize(
    "change",
    [
        lambda k, image: image * (1.0 + 0.2 * DRAWN[k]),
        lambda k, image: image * (1.0 + 0.4 * DRAWN[k]),
        lambda k, image: image * (1.0 + 0.2 * (-1) ** k),
        lambda k, image: 255.0 * (image / 255.0) ** (1.0 + 0.3 * DRAWN[k]),
    ],
    ids=["gain 20 %", "gain 40 %", "to and fro", "gamma"],
)
def test_changes_of_brightness_lose_nothing(change: Change) -> None:
    steady, changed = steady_errors_deg(), errors_deg(change)
    assert len(changed) == len(steady) == 11
    assert np.median(changed) < 1.5 * np.median(steady) + 0.001


def bands(amplitude: float, periods: float, step: float) -> Change:
    """Mains light read row by row: so many periods in an image, which move by a share of one."""
    row = np.linspace(0.0, periods, 240)[:, None]
    return lambda k, image: (
        image * (1.0 + amplitude * np.sin(2.0 * np.pi * (row + step * k + 0.13)))
    )


@pytest.mark.parametrize(
    "change",
    [bands(0.2, 1.0, 0.37), bands(0.2, 2.0, 0.5), bands(0.2, 4.0, 0.29), bands(0.3, 3.0, 0.5)],
    ids=["one", "two to and fro", "four", "three of 30 %"],
)
def test_bands_of_a_rolling_shutter_lose_nothing(change: Change) -> None:
    """Without the gains of the rows half of these pairs have no direction."""
    steady, banded = steady_errors_deg(), errors_deg(change)
    assert len(banded) == len(steady) == 11
    assert np.median(banded) < 3.0 * np.median(steady) + 0.001
