"""Two views through a rolling shutter: exact without noise, honest with it, wrong without it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from farpoint import Camera, PoseStatus, RelativePose, estimate_relative_pose
from farpoint.camera import KannalaBrandt
from farpoint.errors import InputError
from farpoint.geometry import so3
from farpoint.pose.shutter import shutter_of

INTERVAL_S = 1.0 / 30.0
PINHOLE = Camera.pinhole(640, 480, 520.0, 520.0, 319.5, 239.5)
FISHEYE = Camera(
    model=KannalaBrandt(fx=280.0, fy=280.0, cx=319.5, cy=239.5, k1=0.01, k2=-0.005), size=(640, 480)
)
# Of the squared error of a pose (five degrees of freedom) in its 95 %.
INSIDE = 11.07


class Views(NamedTuple):
    """Matches of two views, with the true motion between their middle rows."""

    points0: np.ndarray
    points1: np.ndarray
    R: np.ndarray
    direction: np.ndarray

    def squared_error(self, pose: RelativePose) -> float:
        """Of rotation and direction, over the covariance."""
        assert pose.rotation_cam1_from_cam0 is not None
        assert pose.direction_basis is not None
        assert pose.covariance is not None
        turn = so3.log(self.R @ pose.rotation_cam1_from_cam0.T)
        beta = pose.direction_basis.T @ (self.direction - pose.direction_cam1_from_cam0)
        error = np.concatenate([turn, beta])
        return float(error @ np.linalg.solve(pose.covariance, error))


def views(
    seed: int,
    share: float,
    camera: Camera = PINHOLE,
    *,
    degrees: float = 3.0,
    noise_px: float = 0.3,
    outliers: float = 0.1,
    count: int = 250,
) -> Views:
    """A camera with constant velocities, whose rows are read over a share of the time between."""
    rng = np.random.default_rng((seed, 17))
    theta, way = rng.normal(size=(2, 3))
    theta *= np.radians(degrees) / np.linalg.norm(theta)
    way *= 0.1 / np.linalg.norm(way)
    assert camera.size is not None
    size = np.array(camera.size)
    rays = camera.unproject(rng.uniform(0.0, size, (3 * count, 2)))
    points = rays * rng.uniform(2.0, 30.0, (len(rays), 1))

    def seen(time: float) -> np.ndarray:
        row = np.full(len(points), 0.5 * size[1])
        for _ in range(15):  # the row tells the time, which tells the row
            late = time + share * (row / (size[1] - 1) - 0.5)
            turns = so3.exp(late[:, None] * theta)
            pixels = camera.project(np.einsum("nij,nj->ni", turns, points - late[:, None] * way))
            row = np.where(np.isfinite(pixels[:, 1]), pixels[:, 1], row)
        return pixels

    points0, points1 = seen(0.0), seen(1.0)
    both = np.column_stack([points0, points1])
    inside = (both >= 0.0).all(axis=1) & (both < np.tile(size, 2)).all(axis=1)
    points0, points1 = points0[inside][:count], points1[inside][:count]
    points0 = points0 + rng.normal(0.0, noise_px, points0.shape)
    points1 = points1 + rng.normal(0.0, noise_px, points1.shape)
    wrong = rng.uniform(size=len(points1)) < outliers
    points1[wrong] = rng.uniform(0.0, size, (int(wrong.sum()), 2))
    R = so3.exp(theta)
    direction = -R @ way
    return Views(points0, points1, R, direction / np.linalg.norm(direction))


@pytest.mark.parametrize("camera", [PINHOLE, FISHEYE], ids=["pinhole", "fisheye"])
@pytest.mark.parametrize("share", [0.9, -0.6], ids=["down", "up"])
def test_without_noise_the_motion_of_the_middle_rows_is_found(share, camera):
    case = views(3, share, camera, degrees=5.0, noise_px=0.0, outliers=0.0)
    pose = estimate_relative_pose(
        case.points0, case.points1, camera, readout_s=share * INTERVAL_S, interval_s=INTERVAL_S
    )
    assert pose.status is PoseStatus.OK
    assert np.linalg.norm(so3.log(case.R @ pose.rotation_cam1_from_cam0.T)) < 1e-6
    assert case.direction @ pose.direction_cam1_from_cam0 > np.cos(1e-4)


@pytest.mark.parametrize("share", [0.2, 0.9])
def test_the_pose_is_honest_with_the_shutter_and_not_without(share):
    trials, inside, rotations = 120, {True: 0, False: 0}, {}
    for is_modelled in (True, False):
        given = {"readout_s": share * INTERVAL_S, "interval_s": INTERVAL_S} if is_modelled else {}
        errors = []
        for seed in range(trials):
            case = views(seed, share)
            pose = estimate_relative_pose(case.points0, case.points1, PINHOLE, **given)
            assert pose.status is PoseStatus.OK
            inside[is_modelled] += case.squared_error(pose) < INSIDE
            errors.append(np.linalg.norm(so3.log(case.R @ pose.rotation_cam1_from_cam0.T)))
        rotations[is_modelled] = np.median(errors)
    # 3 sigma of the binomial at 0.95 are 0.06.
    assert inside[True] / trials > 0.89
    assert inside[False] / trials < 0.7
    still = [
        np.linalg.norm(
            so3.log(
                case.R
                @ estimate_relative_pose(
                    case.points0, case.points1, PINHOLE
                ).rotation_cam1_from_cam0.T
            )
        )
        for case in (views(seed, 0.0) for seed in range(trials))
    ]
    assert rotations[True] < 1.15 * np.median(still)
    assert rotations[False] > 1.3 * np.median(still)


def test_a_read_out_that_is_unsure_widens_the_covariance_by_what_it_moves_the_pose():
    case = views(5, 0.6, degrees=5.0)
    at = {"interval_s": INTERVAL_S}
    readout_s, sigma_s = 0.6 * INTERVAL_S, 0.05 * INTERVAL_S
    sure, less, more = (
        estimate_relative_pose(case.points0, case.points1, PINHOLE, readout_s=time_s, **at)
        for time_s in (readout_s, readout_s - sigma_s, readout_s + sigma_s)
    )
    unsure = estimate_relative_pose(
        case.points0, case.points1, PINHOLE.with_readout(readout_s, sigma_s), **at
    )
    moved = 0.5 * so3.log(more.rotation_cam1_from_cam0 @ less.rotation_cam1_from_cam0.T)
    grown = unsure.rotation_covariance - sure.rotation_covariance
    np.testing.assert_allclose(unsure.rotation_cam1_from_cam0, sure.rotation_cam1_from_cam0)
    np.testing.assert_allclose(np.sqrt(np.trace(grown)), np.linalg.norm(moved), rtol=0.15)
    assert np.linalg.matrix_rank(grown, tol=1e-3 * np.trace(grown)) == 1


def test_both_covariances_of_the_rotation_are_one():
    case = views(11, 0.9, degrees=8.0)
    pose = estimate_relative_pose(
        case.points0, case.points1, PINHOLE, readout_s=0.9 * INTERVAL_S, interval_s=INTERVAL_S
    )
    assert abs(np.mean(case.points1[:, 1] - case.points0[:, 1])) > 5.0
    np.testing.assert_allclose(pose.covariance[:3, :3], pose.rotation_covariance)


def test_a_global_shutter_changes_nothing():
    case = views(7, 0.0)
    plain = estimate_relative_pose(case.points0, case.points1, PINHOLE)
    given = estimate_relative_pose(
        case.points0, case.points1, PINHOLE, readout_s=0.0, interval_s=INTERVAL_S
    )
    known = estimate_relative_pose(
        case.points0, case.points1, PINHOLE.with_readout(0.0), interval_s=INTERVAL_S
    )
    for pose in (given, known):
        np.testing.assert_array_equal(pose.covariance, plain.covariance)
        np.testing.assert_array_equal(pose.rotation_cam1_from_cam0, plain.rotation_cam1_from_cam0)


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ({"readout_s": 0.01}, "interval_s"),
        ({"readout_s": 0.01, "interval_s": 0.0}, "interval_s"),
        ({"readout_s": 0.01, "interval_s": np.nan}, "interval_s"),
        ({"readout_s": 0.1, "interval_s": 0.03}, "readout_s"),
        ({"readout_s": "fast", "interval_s": 0.03}, "readout_s"),
    ],
)
def test_times_that_are_none_are_refused(given, name):
    case = views(1, 0.0)
    with pytest.raises(InputError, match=name):
        estimate_relative_pose(case.points0, case.points1, PINHOLE, **given)


def test_points_and_cameras_that_are_none_are_refused():
    points = np.zeros((9, 2))
    at = {"readout_s": 0.01, "interval_s": INTERVAL_S}
    with pytest.raises(InputError, match="points1"):
        estimate_relative_pose(points, np.zeros((9, 3)), PINHOLE, **at)
    with pytest.raises(InputError, match="camera0"):
        estimate_relative_pose(points, points, "a camera", **at)


def test_the_covariance_is_that_of_the_time_between_the_rows():
    """All points move down by a quarter of the image: their rows see 1.2 times the rotation."""
    rng = np.random.default_rng(2)
    theta = np.array([np.radians(12.0), 0.0, 0.0])
    points0 = rng.uniform([20.0, 150.0], [620.0, 460.0], (400, 2))
    scatter, stated, late = [], [], []
    rays = PINHOLE.unproject(points0)
    for _ in range(200):
        noise = rng.normal(0.0, 0.3, (2, *points0.shape))
        row = points0[:, 1].copy()
        for _ in range(12):
            between = 1.0 + 0.8 * (row - points0[:, 1]) / 479.0
            points1 = PINHOLE.project(
                np.einsum("nij,nj->ni", so3.exp(between[:, None] * theta), rays)
            )
            row = points1[:, 1]
        pose = estimate_relative_pose(
            points0 + noise[0], points1 + noise[1], PINHOLE, readout_s=0.8, interval_s=1.0
        )
        scatter.append(so3.log(so3.exp(theta) @ pose.rotation_cam1_from_cam0.T))
        stated.append(pose.rotation_covariance)
        late.append(between.mean())
    assert abs(np.mean(late) - 1.0) > 0.15
    nees = np.mean([e @ np.linalg.solve(C, e) for e, C in zip(scatter, stated, strict=True)])
    # 3 degrees of freedom; three sigma of the mean of 200. Undivided it would be off by late^2.
    assert 2.5 < nees < 3.5


def test_rows_need_the_height_of_the_images():
    camera = Camera(model=PINHOLE.model)
    points = np.zeros((9, 2))
    with pytest.raises(InputError, match="size"):
        shutter_of(camera, points, points, 0.01, 0.03)
