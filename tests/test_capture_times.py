"""Times of capture from time stamps that jitter, and from those that do not."""

from __future__ import annotations

import numpy as np
import pytest

from farpoint import Camera, Odometry
from farpoint.odometry.capture_times import CaptureTimes
from farpoint.synthetic import render_drive

PERIOD_S = 1.0 / 30.0


def captured(stamps: np.ndarray) -> np.ndarray:
    times = CaptureTimes()
    return np.array([times.update(float(stamp)) for stamp in stamps])


@pytest.mark.parametrize("seed", range(5))
def test_jitter_of_a_constant_period_is_taken_out(seed):
    rng = np.random.default_rng(seed)
    counts = np.cumsum(rng.choice([1, 1, 1, 1, 1, 1, 1, 1, 1, 2], 150))  # a tenth are missing
    stamps = 5.0 + PERIOD_S * counts + rng.uniform(0.0, 0.007, 150)
    true = PERIOD_S * np.diff(counts)[40:]
    errors = np.std(np.diff(captured(stamps))[40:] - true)
    assert errors < 0.3 * np.std(np.diff(stamps)[40:] - true)


def test_exact_times_stay_as_they_are():
    stamps = np.arange(60) / 30.0
    np.testing.assert_array_equal(captured(stamps), stamps)


def test_a_period_that_varies_is_kept():
    """As a phone's, which follows the light: intervals are right, and no line has the stamps."""
    rng = np.random.default_rng(2)
    kept = 0
    for _ in range(20):
        stamps = np.cumsum(rng.uniform(0.028, 0.042, 120))
        kept += np.count_nonzero((captured(stamps) == stamps)[20:])
    assert kept > 0.95 * 20 * 100


def test_times_rise_with_their_stamps():
    rng = np.random.default_rng(3)
    stamps = np.cumsum(rng.exponential(0.03, 300))
    assert (np.diff(captured(stamps)) > 0.0).all()
    assert captured(np.array([1.0, 1.0, 1.0])).tolist() == [1.0, 1.0, 1.0]


def test_final_poses_have_the_stamps_of_their_frames():
    camera = Camera.pinhole(160, 120, 120.0, 120.0, 79.5, 59.5)
    odometry, rng, final = Odometry(camera), np.random.default_rng(4), []
    stamps = (np.arange(16) * 0.1 + rng.uniform(0.0, 0.02, 16)).tolist()
    for frame, stamp in zip(render_drive(camera, frames=16, seed=0), stamps, strict=True):
        odometry.process(frame.image, stamp)
        final += odometry.final_poses()
    final += odometry.remaining()
    assert [pose.timestamp for pose in final] == stamps
