"""Half a kilometre through streets by a lens that was calibrated wrong: one scale throughout."""

from __future__ import annotations

import numpy as np
import pytest
from drive_kit import Drive
from street_kit import FPS, SIZE, StreetDrive

from farpoint import Camera
from farpoint.metrics import align_sim3
from farpoint.path.options import LensRefinementOptions, PathOptions

FRAMES = 700
FOCAL_PX = 718.9
# KITTI's rectified images (sequence 00) have about this of their lens left.
TRUE = Camera.pinhole(
    *SIZE, 0.991 * FOCAL_PX, 0.991 * FOCAL_PX, 607.2, 185.2, distortion=(0.011, 0.0, 0.0, 0.0)
)
GIVEN = Camera.pinhole(*SIZE, FOCAL_PX, FOCAL_PX, 607.2, 185.2)


@pytest.fixture(scope="module")
def drive() -> tuple[StreetDrive, Drive]:
    street = StreetDrive(TRUE, FRAMES, seed=31)
    path = Drive(PathOptions(), LensRefinementOptions(), GIVEN, fps=FPS)
    for tracks in street:
        path.add(tracks)
    return street, path.finish()


def positions(path: Drive) -> np.ndarray:
    found = {pose.frame1: pose.world_from_cam[:3, 3] for pose in path.settled}
    return np.array([found.get(k, np.zeros(3)) for k in range(FRAMES)])


def test_the_scale_stays(drive):
    street, path = drive
    assert path.points[-1].segment == 0
    assert not any(point.scale_is_guessed for point in path.points)
    lengths = [
        np.linalg.norm(np.diff(p[::10], axis=0), axis=1) for p in (positions(path), street.p)
    ]
    scales = np.log(lengths[0] / lengths[1])
    drift = scales[-8:].mean() - scales[:8].mean()
    last = path.points[-1]
    print(drift, np.ptp(scales), last.scale_sigma / last.scale)
    assert abs(drift) < 0.03
    assert abs(drift) < 3.0 * last.scale_sigma / last.scale < 0.15


def test_the_path_is_right(drive):
    street, path = drive
    found = positions(path)
    fit = align_sim3(found, street.p)
    aligned = fit.scale * found @ fit.rotation.T + fit.translation
    error = np.sqrt(np.mean(np.sum((aligned - street.p) ** 2, axis=1)))
    print(error)
    assert error < 1.0  # m, of 560


def test_the_lens_is_found(drive):
    _, path = drive
    report = path.builder.report()
    off = report.camera.model.fx - TRUE.model.fx
    print(off, report.sigma["fx"])
    assert abs(off) < 3.0 * report.sigma["fx"] < 6.0
