"""Motions that the search overlooks, and that its candidates find."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from pose_kit import estimate, point_scene, rotation_error

from farpoint import PoseStatus, RelativePose, RelativePoseOptions
from farpoint.geometry import so3
from farpoint.pose.candidates import candidate_motions
from farpoint.pose.far_rotation import far_rotation
from farpoint.pose.general_motion import GeneralMotionFit, fit_general_motion, refit_general_motion
from farpoint.pose.matches import matches_from_points
from farpoint.synthetic import PointScene
from farpoint.synthetic.pairs import HardPair, mostly_far, pure_rotation, road

TOLERANCE = 1.5


def fit_of(scene: PointScene | HardPair) -> GeneralMotionFit:
    matches = matches_from_points(scene.points0, scene.points1, scene.camera, scene.camera)
    return fit_general_motion(matches, TOLERANCE, RelativePoseOptions(), np.zeros(1, np.uint64))


def candidates_of(fit: GeneralMotionFit) -> list[GeneralMotionFit]:
    options, state = RelativePoseOptions(), np.zeros(1, np.uint64)
    return [*candidate_motions(fit.matches, fit, TOLERANCE, options, state)]


class Lost(NamedTuple):
    rotations: int
    of_them_sure: int
    of_the_search: int


@pytest.fixture(scope="module")
def lost() -> Lost:
    """How many rotations are a degree off or missing; how many of these have a direction."""
    rotations = sure = alone = 0
    for seed in range(300):
        scene = road(seed)
        apart = so3.angle_between(fit_of(scene).R_cam1_from_cam0, scene.rotation_cam1_from_cam0)
        alone += apart > np.radians(1.0)
        pose = estimate(scene)
        if pose.status is not PoseStatus.FAILED:
            off = np.linalg.norm(rotation_error(pose, scene.rotation_cam1_from_cam0))
            if off < np.radians(1.0):
                continue
        rotations += 1
        sure += pose.status is PoseStatus.OK
    return Lost(rotations, sure, alone)


def test_fewer_motions_are_lost(lost):
    assert lost.rotations < 0.7 * lost.of_the_search


def test_hardly_any_is_lost_and_sure(lost):
    assert lost.of_them_sure <= 0.03 * 300


LOST = (20, 49, 64, 80, 97, 146, 160, 178, 240, 267, 268, 279)


def nees_of(pose: RelativePose, scene: PointScene) -> float:
    error = rotation_error(pose, scene.rotation_cam1_from_cam0)
    return float(error @ np.linalg.solve(pose.rotation_covariance, error))


def test_few_near_points_show_a_motion_that_all_others_would_take_for_a_turn():
    """As a turn it is 0.4 deg off, 30 times its sigma: so are 12 of 1000, 16 without a pool."""
    scenes = [mostly_far(seed) for seed in range(1000, 1250)]
    poses = [estimate(scene) for scene in scenes]
    assert sum("Pure rotation or" in pose.reason for pose in poses) <= 6
    assert sum(nees_of(*each) > 16.0 for each in zip(poses, scenes, strict=True)) <= 6
    assert sum(pose.status is PoseStatus.OK for pose in poses) >= 225


def test_the_search_alone_overlooks_it():
    overlooked = found = 0
    for scene in map(mostly_far, LOST):
        fit = fit_of(scene)
        motions = [fit, *(refit_general_motion(fit.matches, each) for each in candidates_of(fit))]
        R_true = scene.rotation_cam1_from_cam0
        apart = [so3.angle_between(each.R_cam1_from_cam0, R_true) for each in motions]
        overlooked += apart[0] > np.radians(0.3)
        found += min(apart[1:]) < np.radians(0.25)
    assert overlooked >= 10
    assert found >= 5


def test_with_many_matches_no_candidate_is_lost_by_subsampling():
    for seed in (25, 82, 172):
        scene = mostly_far(seed, matches=5000)
        assert nees_of(estimate(scene), scene) < 16.0


def test_wrong_matches_make_no_motion_of_a_turn():
    for seed in range(150):
        assert estimate(pure_rotation(seed)).status is PoseStatus.ROTATION_ONLY


def test_a_plain_motion_has_no_candidates():
    assert [len(candidates_of(fit_of(point_scene(seed)))) for seed in range(5)] == [0] * 5


def test_the_closed_form_of_2008_is_a_candidate():
    """The rotation of the far points, and the epipole of the flow of the near points."""
    for seed in range(5):
        scene = mostly_far(seed)
        fit = fit_of(scene)
        far = far_rotation(fit.matches, TOLERANCE, np.zeros(1, np.uint64)).R_cam1_from_cam0
        apart = [so3.angle_between(each.R_cam1_from_cam0, far) for each in candidates_of(fit)]
        assert min(apart) < 5e-4  # each search draws other samples
