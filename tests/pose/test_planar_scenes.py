"""Walls and floors: nearly everything on a plane, which allows a second motion."""

from __future__ import annotations

import os

import numpy as np
import pytest

from farpoint import (
    Camera,
    PoseStatus,
    RelativePose,
    RelativePoseOptions,
    estimate_relative_pose,
)
from farpoint.geometry import so3, sphere
from farpoint.metrics import statistics as metrics
from farpoint.pose.general_motion import GeneralMotionFit, fit_general_motion
from farpoint.pose.matches import matches_from_points
from farpoint.pose.posterior import Alternative, Posterior, compare_motions
from farpoint.pose.pure_rotation import lazy_pure_rotation

CAMERA = Camera.pinhole(640, 480, 500.0, 500.0, 319.5, 239.5)
NORMAL = np.array([0.45, -0.25, 1.0]) / 4.0
NOISE_PX = 0.2


def compared(points0: np.ndarray, points1: np.ndarray, camera: Camera = CAMERA) -> Posterior:
    """The motion that the search finds, compared with the other motion of the plane."""
    matches = matches_from_points(points0, points1, camera, camera)
    fit = fit_general_motion(matches, 1.5, RelativePoseOptions(), np.zeros(1, np.uint64))
    rotation = lazy_pure_rotation(matches, fit.far_rotation_cam1_from_cam0, 1.5)
    return compare_motions(matches, fit, [], rotation, 1e-3)


def wall(seed: int, direction: np.ndarray, off_the_wall: int) -> tuple[np.ndarray, np.ndarray]:
    """Pixels of 100 points seen from two places 12 cm apart, some in front of the wall."""
    return seen_wall(seed, direction, off_the_wall)[:2]


def seen_wall(
    seed: int, direction: np.ndarray, off_the_wall: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """As `wall`, and the true rotation."""
    rng = np.random.default_rng(seed)
    points0 = rng.uniform((0.0, 0.0), (639.0, 479.0), (100, 2))
    rays = CAMERA.unproject(points0)
    depth = 1.0 / (rays @ NORMAL)
    depth[:off_the_wall] *= rng.uniform(0.5, 0.8, off_the_wall)
    R = so3.exp(np.radians(rng.uniform(-3.0, 3.0, 3)))
    points1 = CAMERA.project(depth[:, None] * rays @ R.T + 0.12 * direction)
    seen = np.isfinite(points1).all(axis=1)
    noise = rng.normal(0.0, NOISE_PX, (2, seen.sum(), 2))
    return points0[seen] + noise[0], points1[seen] + noise[1], R


def is_right(pose: RelativePose, direction: np.ndarray) -> bool:
    """Whether this direction is given; that of the other motion is 30 degrees away and more."""
    found = pose.direction_cam1_from_cam0
    return found is not None and float(sphere.angle_between(found, direction)) < np.radians(20.0)


@pytest.mark.parametrize(
    "direction",
    [(1.0, 0.0, 0.0), (-0.8, 0.1, -0.5), (0.8, -0.1, 0.5)],
    ids=["side", "back", "ahead"],
)
def test_a_few_points_before_a_wall_tell_which_of_the_two_motions_it_was(direction):
    direction = sphere.normalize(np.array(direction))
    told = []
    for seed in range(40):
        pose = estimate_relative_pose(*wall(seed, direction, off_the_wall=3), CAMERA, seed=seed)
        told.append(is_right(pose, direction))
    assert np.mean(told) > 0.9


@pytest.fixture(scope="module")
def bare_walls() -> list[tuple[RelativePose, np.ndarray, np.ndarray]]:
    """Estimates from walls with nothing before them; true rotations and directions."""
    found = []
    for direction in map(sphere.normalize, np.array([(0.4, 0.3, -0.85), (-0.8, 0.1, -0.5)])):
        for seed in range(40):
            points0, points1, R = seen_wall(seed, direction, off_the_wall=0)
            found.append((estimate_relative_pose(points0, points1, CAMERA), R, direction))
    return found


def test_a_bare_wall_allows_two_motions(bare_walls):
    said = ["allows two motions" in pose.reason for pose, _, _ in bare_walls]
    assert np.mean(said) > 0.8
    assert all(
        pose.status is PoseStatus.ROTATION_ONLY
        for (pose, _, _), two in zip(bare_walls, said, strict=True)
        if two
    )


def test_a_wall_tells_the_two_apart_where_one_has_points_behind_the_camera():
    # Of a motion along the wall: the other one is towards it, past half of its points.
    direction = np.array([1.0, 0.0, 0.0])
    poses = [estimate_relative_pose(*wall(seed, direction, 0), CAMERA) for seed in range(40)]
    assert np.mean([is_right(pose, direction) for pose in poses]) > 0.9


def test_the_rotation_before_a_bare_wall_is_as_sure_as_two_motions_leave_it(bare_walls):
    errors, covariances = [], []
    for pose, R, _ in bare_walls:
        if "allows two motions" in pose.reason:
            errors.append(so3.log(R @ pose.rotation_cam1_from_cam0.T))
            covariances.append(pose.rotation_covariance)
    assert np.mean(metrics.nees(np.array(errors), np.array(covariances)) < 7.81) > 0.9


def rough_wall(seed: int, count: int, relief: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels of points about any wall 4 m away, seen from 12 cm on in any direction; and that."""
    rng = np.random.default_rng([seed, count])
    points0 = rng.uniform((0.0, 0.0), (639.0, 479.0), (count, 2))
    rays = CAMERA.unproject(points0)
    depth = 4.0 / (rays @ sphere.normalize(np.r_[rng.normal(0.0, 0.4, 2), 1.0]))
    depth = np.clip(depth, 0.5, 40.0) * (1.0 + relief * rng.normal(size=count))
    R = so3.exp(np.radians(rng.uniform(-3.0, 3.0, 3)))
    direction = sphere.normalize(rng.normal(size=3))
    points1 = CAMERA.project(depth[:, None] * rays @ R.T + 0.12 * direction)
    seen = np.isfinite(points1).all(axis=1)
    noise = rng.normal(0.0, NOISE_PX, (2, seen.sum(), 2))
    return points0[seen] + noise[0], points1[seen] + noise[1], direction


@pytest.mark.parametrize("wrong_share", [0.2, 0.5])
def test_wrong_matches_do_not_hide_that_a_wall_allows_two_motions(wrong_share):
    # Of one that goes exactly through a wrong match, the plane was that of this match.
    given, wrong = 0, 0
    for seed in range(150):
        points0, points1, direction = rough_wall(seed, 40, 0.005)
        rng, bad = np.random.default_rng(seed), round(wrong_share * len(points1))
        points1[:bad] = rng.uniform((0.0, 0.0), (639.0, 479.0), (bad, 2))
        pose = estimate_relative_pose(points0, points1, CAMERA, seed=seed)
        if pose.direction_cam1_from_cam0 is not None:
            given += 1
            wrong += not is_right(pose, direction)
    assert given > 20
    assert wrong <= 0.04 * given


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="takes minutes")
@pytest.mark.parametrize("relief", [0.0, 0.005])
def test_many_matches_on_a_bare_wall_speak_for_neither_of_its_motions(relief):
    given, wrong = 0, 0
    for seed in range(300):
        points0, points1, direction = rough_wall(seed, 200 + 100 * (seed % 2), relief)
        pose = estimate_relative_pose(points0, points1, CAMERA, seed=seed)
        if pose.direction_cam1_from_cam0 is not None:
            given += 1
            wrong += not is_right(pose, direction)
    assert given > 100
    assert wrong <= 1


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="takes minutes")
def test_the_odds_of_the_two_motions_are_those_of_being_wrong():
    wrong, chance = [], []
    for seed in range(360):
        count, relief = ((40, 0.0), (40, 0.01), (120, 0.0), (120, 0.01))[seed % 4]
        points0, points1, direction = rough_wall(seed, count, relief)
        fit, _, other = compared(points0, points1)
        if other is not None:
            off = sphere.angle_between(fit.direction_cam1_from_cam0, direction)
            wrong.append(off > np.radians(20.0))
            chance.append(1.0 / (1.0 + np.exp(min(other.log_ratio, 50.0))))
    p = np.array(chance)
    assert len(p) > 200
    assert abs(sum(wrong) - p.sum()) < 3.0 * np.sqrt(np.sum(p * (1.0 - p)))
    assert (p < 0.05).sum() > 40


@pytest.mark.parametrize("degrees", [0.0, 3.0, 6.0, 9.0])
def test_straight_to_a_wall_the_direction_is_as_sure_as_the_other_motion_lets_it_be(degrees):
    """The other motion is as far from the first as that from the normal of the wall."""
    nees, said = [], 0
    for seed in range(80):
        rng = np.random.default_rng([seed, 7])
        points0 = rng.uniform((0.0, 0.0), (639.0, 479.0), (100, 2))
        rays = CAMERA.unproject(points0)
        R = so3.exp(np.radians(rng.uniform(-3.0, 3.0, 3)))
        axis = sphere.normalize(np.cross(NORMAL, rng.normal(size=3)))
        direction = R @ so3.exp(np.radians(degrees) * axis) @ -sphere.normalize(NORMAL)
        points1 = CAMERA.project(rays / (rays @ NORMAL)[:, None] @ R.T + 0.3 * direction)
        noise = rng.normal(0.0, 0.05, (2, len(points0), 2))
        seen = np.isfinite(points1).all(axis=1)
        pose = estimate_relative_pose(
            points0[seen] + noise[0, seen], points1[seen] + noise[1, seen], CAMERA
        )
        if pose.status is PoseStatus.OK:
            said += "allows two motions" in pose.reason
            tilt = pose.direction_basis.T @ direction
            nees.append(tilt @ np.linalg.solve(pose.covariance[3:, 3:], tilt))
    assert len(nees) > 50
    # 2 degrees of freedom. Held for the only one, half of the directions were 4 sigma off and more.
    assert np.mean(np.array(nees) < 5.99) > 0.85
    assert np.mean(np.array(nees) > 18.0) < 0.03
    assert said > (0.9 if degrees >= 3.0 else 0.2) * len(nees)


def wall_ahead(
    seed: int, count: int, relief: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Pixels of points about a wall 2 m away, from 20 cm on and up to 12 degrees off straight.

    And the true rotation and direction.
    """
    rng = np.random.default_rng([seed, count, 11])
    points0 = rng.uniform((0.0, 0.0), (639.0, 479.0), (count, 2))
    rays = CAMERA.unproject(points0)
    normal = sphere.normalize(np.r_[rng.normal(0.0, 0.3, 2), 1.0])
    depth = 2.0 / (rays @ normal) * (1.0 + relief * rng.normal(size=count))
    axis = sphere.normalize(np.cross(normal, rng.normal(size=3)))
    R = so3.exp(np.radians(rng.uniform(-3.0, 3.0, 3)))
    ahead = so3.exp(np.radians(rng.uniform(0.0, 12.0)) * axis) @ normal
    direction = rng.choice([-1.0, 1.0]) * R @ ahead
    points1 = CAMERA.project(depth[:, None] * rays @ R.T + 0.2 * direction)
    seen = np.isfinite(points1).all(axis=1) & (depth > 0.0)
    noise = rng.normal(0.0, 0.22, (2, seen.sum(), 2))
    return points0[seen] + noise[0], points1[seen] + noise[1], R, direction


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="takes minutes")
@pytest.mark.parametrize(("count", "relief"), [(90, 0.0), (300, 0.0), (300, 0.02)])
def test_poses_towards_a_wall_with_little_relief_lie_within_their_covariances(count, relief):
    """Between the two motions of a plane anything is likely, even if the other one is not."""
    errors, covariances = [], []
    for seed in range(150):
        points0, points1, R, direction = wall_ahead(seed, count, relief)
        pose = estimate_relative_pose(points0, points1, CAMERA)
        if pose.status is PoseStatus.OK:
            turn = so3.log(R @ pose.rotation_cam1_from_cam0.T)
            tilt = pose.direction_basis.T @ (direction - pose.direction_cam1_from_cam0)
            errors.append(np.r_[turn, tilt])
            covariances.append(pose.covariance)
    nees = metrics.nees(np.array(errors), np.array(covariances))
    assert len(nees) > 80
    # Five degrees of freedom. Of covariances that allow for the other motion alone, and only where
    # it is likely, 0.71 to 0.82 held the truth.
    assert np.mean(nees < 11.07) > 0.85


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="takes minutes")
def test_the_other_motion_of_a_wall_is_never_the_first_one():
    """All matches may lead back to the first, from the second that was the likelier."""
    apart = []
    for seed in range(150):
        points0, points1, _, _ = wall_ahead(seed, 300, 0.0)
        fit, _, other = compared(points0, points1)
        if other is not None:
            towards = fit.direction_cam1_from_cam0
            apart.append(sphere.angle_between(towards, other.direction_cam1_from_cam0))
    assert len(apart) > 100
    assert np.min(apart) > np.radians(0.1)  # of 149, 41 were nearer


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="takes minutes")
def test_nothing_before_a_bare_floor_speaks_for_the_wrong_motion():
    """Of a wide lens a pixel's noise turns rays the less, outwards, the farther out they are."""
    camera = Camera.pinhole(640, 480, 250.0, 250.0, 319.5, 239.5)
    for_right = []
    for seed in range(160):
        rng = np.random.default_rng([seed, 13])
        points0 = rng.uniform((0.0, 250.0), (639.0, 479.0), (300, 2))
        rays = camera.unproject(points0)
        direction = sphere.normalize(rng.normal(size=3) * (1.0, 0.3, 1.0))
        R = so3.exp(np.radians(rng.uniform(-2.0, 2.0, 3)))
        points1 = camera.project(1.5 * rays / rays[:, 1:2] @ R.T + 0.05 * direction)
        noise = rng.normal(0.0, NOISE_PX, (2, len(points0), 2))
        seen = np.isfinite(points1).all(axis=1)
        points = points0[seen] + noise[0, seen], points1[seen] + noise[1, seen]
        fit, _, other = compared(*points, camera)
        if other is not None:
            nearer = fit.direction_cam1_from_cam0 - other.direction_cam1_from_cam0
            for_right.append(np.copysign(other.log_ratio, nearer @ direction))
    assert len(for_right) > 50
    # By the same noise any way, it was -5.2.
    assert np.quantile(for_right, 0.1) > -2.0


@pytest.fixture
def first_motion() -> GeneralMotionFit:
    """Of a wall passed sideways."""
    matches = matches_from_points(*wall(0, np.array([1.0, 0.0, 0.0]), 0), CAMERA, CAMERA)
    return fit_general_motion(matches, 1.5, RelativePoseOptions(), np.zeros(1, np.uint64))


def beside(
    fit: GeneralMotionFit, turn: np.ndarray, tilt: np.ndarray, against: float
) -> Alternative:
    """A motion that differs from the first by as much."""
    direction = fit.direction_cam1_from_cam0
    return Alternative(
        so3.exp(turn) @ fit.R_cam1_from_cam0,
        sphere.retract(direction, sphere.tangent_basis(direction), tilt),
        against,
        "",
    )


@pytest.mark.parametrize(("against", "chance"), [(0.0, 0.5), (10.0, 1.0 / (1.0 + np.exp(3.0)))])
def test_a_motion_that_may_be_the_other_one_errs_by_what_lies_between(
    first_motion, against, chance
):
    """Nine tenths of it that way, and a tenth turned by a quarter about the direction."""
    turn, tilt = np.array([0.01, -0.02, 0.005]), np.array([0.03, 0.05])
    direction = first_motion.direction_cam1_from_cam0
    basis = sphere.tangent_basis(direction)
    quarter = so3.exp(0.5 * np.pi * direction)
    along = np.r_[turn, tilt]
    across = np.r_[quarter @ turn, basis.T @ quarter @ basis @ tilt]
    expected = chance * (0.9 * np.outer(along, along) + 0.1 * np.outer(across, across))
    doubt = beside(first_motion, turn, tilt, against).covariance_beside(first_motion)
    np.testing.assert_allclose(doubt, expected, atol=1e-5)


def test_a_motion_that_goes_quite_another_way_widens_no_covariance(first_motion):
    other = beside(first_motion, np.full(3, 0.01), np.array([0.6, 0.0]), 0.0)
    assert not other.covariance_beside(first_motion).any()
