"""Which of several motions it was, and when there is no telling."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pose_kit import estimate, point_scene, rotation_error
from scipy.stats import chi2

from farpoint import PoseStatus, RelativePose, RelativePoseOptions
from farpoint._kernels.ambiguous_motions import bas_relief_motion
from farpoint.bench.scenes import draw_scenes
from farpoint.geometry import so3, sphere
from farpoint.pose.general_motion import GeneralMotionFit, fit_general_motion, refit_general_motion
from farpoint.pose.matches import matches_from_points
from farpoint.pose.posterior import Alternative, Posterior, _log_ratio, compare_motions
from farpoint.pose.pure_rotation import fit_pure_rotation
from farpoint.synthetic import PointScene

UP = np.array([0.0, 1.0, 0.0])
RATE = 1e-3


def fit_of(scene: PointScene) -> GeneralMotionFit:
    matches = matches_from_points(scene.points0, scene.points1, scene.camera, scene.camera)
    return fit_general_motion(matches, 1.5, RelativePoseOptions(), np.zeros(1, np.uint64))


@pytest.fixture(scope="module")
def fit() -> GeneralMotionFit:
    return fit_of(point_scene(3))


def compared(fit: GeneralMotionFit, *candidates: GeneralMotionFit) -> Posterior:
    rotation = fit_pure_rotation(fit.matches, fit.far_rotation_cam1_from_cam0, 1.5)
    return compare_motions(fit.matches, fit, candidates, lambda: rotation, RATE)


def twin_of(fit: GeneralMotionFit) -> GeneralMotionFit:
    """The bas-relief alternative of a motion, refined: a local maximum of the likelihood."""
    R, t = np.empty((3, 3)), np.empty(3)
    pairs, gate = fit.matches.pairs, 3.0 * fit.noise.sigma
    direction = fit.direction_cam1_from_cam0
    bas_relief_motion(pairs, len(fit.matches), gate, fit.R_cam1_from_cam0, direction, R, t)
    found = refit_general_motion(fit.matches, fit.at(R, t))
    assert found.direction_cam1_from_cam0 @ direction < -0.9
    return found


@pytest.fixture(scope="module")
def short() -> GeneralMotionFit:
    """Of a step of 2 cm, whose bas-relief alternative is a local maximum."""
    return fit_of(point_scene(0, matches=90, outliers=10, translation_m=(0.02, 0.01, 0.0)))


def test_a_candidate_that_is_likelier_is_taken(short):
    wrong = twin_of(short)
    assert wrong.log_evidence < short.log_evidence
    found = compared(wrong, short)
    np.testing.assert_allclose(
        found.fit.direction_cam1_from_cam0, short.direction_cam1_from_cam0, atol=1e-3
    )


def test_one_that_is_less_likely_is_not(short):
    assert compared(short, twin_of(short)).fit is short


def test_a_motion_is_ruled_out_at_the_false_alarm_rate(short):
    """By a log ratio of log(1000), times the tempering of the matches."""
    wrong = twin_of(short)
    ratio = _log_ratio(short, wrong)
    limit = ratio / -np.log(RATE)
    assert limit > 1.0
    for tempering, is_possible in ((0.9 * limit, False), (1.1 * limit, True)):
        tempered = short.matches.with_design_effect(tempering, is_misspecified=False)
        given = replace(short, matches=tempered)
        rotation = fit_pure_rotation(tempered, short.far_rotation_cam1_from_cam0, 1.5)
        found = compare_motions(tempered, given, [wrong], lambda r=rotation: r, RATE)
        assert (found.alternative is not None) == is_possible


def test_residuals_and_evidence_both_count(short):
    """The log ratio by residuals alone is that of the kernel, 0 where the modes are the same."""
    wrong = twin_of(short)
    difference = short.log_evidence - wrong.log_evidence
    assert _log_ratio(short, wrong) > difference > 0.0
    assert _log_ratio(short, short) == 0.0


def test_the_same_motion_is_no_alternative(fit):
    found = compared(fit, fit)
    assert found.alternative is None


def test_a_candidate_that_correlates_residuals_is_not_taken(fit):
    """As a merged mode of two motions does, which may be likelier than either."""
    likelier = replace(fit, cost=fit.cost + 1.0)
    assert compared(likelier, fit).fit is not likelier
    merged = replace(fit)
    merged.__dict__["neighbours"] = fit.neighbours._replace(correlation=0.8, z_score=9.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("farpoint.pose.posterior.refit_general_motion", lambda *_: merged)
        assert compared(likelier, fit).fit is likelier
        # Where the fit has such residuals, too, the likelier one is taken.
        likelier.__dict__["neighbours"] = merged.neighbours
        assert compared(likelier, fit).fit is merged


def test_a_plain_motion_has_no_alternative(fit):
    assert compared(fit).alternative is None


def test_the_prior_of_the_parallax_counts_for_few_matches(fit):
    """For 5 sqrt(N) of N."""
    plain = replace(fit, per_match=np.ones_like(fit.per_match))
    likelier = replace(plain, per_match=plain.per_match.copy())
    likelier.per_match[0] = np.e
    likelier = replace(likelier, cost=plain.cost - 1.0)  # the likelihood has the prior in it
    gain = likelier.log_evidence - plain.log_evidence
    assert gain == pytest.approx(5.0 * np.sqrt(len(fit.matches)))


def test_a_motion_with_most_points_behind_the_cameras_is_unlikely(fit):
    assert replace(fit, sign_log_odds=-100.0).log_evidence == pytest.approx(
        fit.log_evidence - 100.0
    )


def test_the_covariance_by_another_rotation_is_largest_about_the_axis_between_them(fit):
    turn = np.radians([0.3, -0.2, 0.1])
    R = so3.exp(turn) @ fit.R_cam1_from_cam0
    added = Alternative(R, UP, 0.0, "").rotation_covariance_beside(fit)
    values, axes = np.linalg.eigh(added)
    square = turn @ turn
    # The mean square error is that of two that are as likely.
    assert np.trace(added) == pytest.approx(0.5 * square)
    np.testing.assert_allclose(values[:2], 0.5 * 0.1 / 3.0 * square)
    assert abs(axes[:, 2] @ turn) == pytest.approx(np.sqrt(square))


def test_the_covariance_grows_with_the_odds_of_another_rotation(fit):
    R = so3.exp(np.radians([0.3, -0.2, 0.1])) @ fit.R_cam1_from_cam0

    def added(log_ratio):
        return np.trace(Alternative(R, UP, log_ratio, "").rotation_covariance_beside(fit))

    # Half of a log likelihood counts: one of ten.
    assert added(2.0 * np.log(9.0)) == pytest.approx(added(0.0) / 5.0)
    # Where the noise was given, its variance may be four times as large.
    other = Alternative(R, UP, 8.0 * np.log(9.0), "")
    assert other.probability(4.0) == pytest.approx(0.1)


@pytest.fixture(scope="module")
def ambiguous() -> list[tuple[PointScene, RelativePose]]:
    """Of 500 scenes with 90 matches and 2 px, 5 cm: those that allow two motions."""
    grid = {"far_share": 0.0, "matches": 90, "outliers": 18, "noise_px": 2.0}
    scenes = draw_scenes(500, np.random.default_rng(2), baseline_m=0.05, **grid)
    poses = [(scene, estimate(scene)) for scene in scenes]
    # A second motion nearby is in the covariance of the first.
    return [
        (scene, pose)
        for scene, pose in poses
        if ("allows two motions" in pose.reason or "explained by two motions" in pose.reason)
        and pose.status is PoseStatus.ROTATION_ONLY
    ]


def test_rotations_with_an_alternative_lie_within_their_covariances(ambiguous):
    nees = []
    for scene, pose in ambiguous:
        error = rotation_error(pose, scene.rotation_cam1_from_cam0)
        nees.append(error @ np.linalg.solve(pose.rotation_covariance, error))
    assert len(nees) > 60
    assert np.mean(np.array(nees) < chi2.ppf(0.95, 3)) > 0.92
    assert 0.75 < np.mean(np.array(nees) < chi2.ppf(0.68, 3)) < 0.95


def test_two_motions_stay_possible_with_misspecified_noise():
    """The same noise given for all matches is no more than what is assumed, but may be wrong."""
    given = np.tile(np.eye(2), (40, 1, 1))
    firm = unsure = because = 0
    for seed in range(60):
        drawn = point_scene(
            seed, matches=40, outliers=0, far_share=0.0, translation_m=(0.02, 0.015, 0.01)
        )
        poses = [
            estimate(drawn),
            estimate(drawn, covariance0_px2=given, covariance1_px2=given),
        ]
        firm += poses[0].status is PoseStatus.OK
        unsure += poses[1].status is PoseStatus.OK
        because += "two motions" in poses[1].reason
    assert firm >= 57
    assert because >= 9
    assert unsure < firm


def test_directions_of_short_steps_are_hardly_ever_those_of_another_mode():
    """2 cm to the side with 1 px: without a search in other directions, 3 in 100 are."""
    given = wrong = 0
    for seed in range(150):
        scene = point_scene(
            seed, matches=90, outliers=0, noise_px=1.0, translation_m=(0.02, 0.0, 0.0)
        )
        pose = estimate(scene)
        if pose.direction_cam1_from_cam0 is not None:
            given += 1
            apart = sphere.angle_between(
                pose.direction_cam1_from_cam0, scene.direction_cam1_from_cam0
            )
            wrong += apart > np.radians(30.0)
    assert given >= 90
    assert wrong <= 2
