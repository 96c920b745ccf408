"""Which of two motions it was, and when there is no telling."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pose_kit import estimate, point_scene, rotation_error
from scipy.stats import chi2

from farpoint import PoseStatus, RelativePose, RelativePoseOptions
from farpoint._kernels.ambiguous_motions import bas_relief_motion
from farpoint._kernels.pose import Pose
from farpoint.bench.scenes import draw_scenes
from farpoint.geometry import so3
from farpoint.pose import competing_motions, two_views
from farpoint.pose.competing_motions import ELSEWHERE, PLANE, CompetingMotion
from farpoint.pose.general_motion import GeneralMotionFit, fit_general_motion, refit_general_motion
from farpoint.pose.matches import matches_from_points
from farpoint.pose.pure_rotation import PureRotationFit, fit_pure_rotation
from farpoint.synthetic import PointScene

AHEAD, UP = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])


@pytest.fixture(scope="module")
def fit():
    drawn = point_scene(3)
    matches = matches_from_points(drawn.points0, drawn.points1, drawn.camera, drawn.camera)
    return fit_general_motion(matches, 1.5, RelativePoseOptions(), np.zeros(1, np.uint64))


def pure_rotation_of(fit: GeneralMotionFit) -> PureRotationFit:
    return fit_pure_rotation(fit.matches, fit.far_rotation_cam1_from_cam0, 1.5)


@pytest.fixture
def unlikely(fit):
    """The same, if all matches made it much less likely."""
    return replace(fit, cost=fit.cost + 1e3)


@pytest.fixture
def elsewhere(fit, monkeypatch):
    """`likelier_in_other_direction` where the motions found, in turn, are so much less likely."""

    def run(*against: float, fit: GeneralMotionFit = fit):
        waiting = list(against)

        def nearest(_matches, _pose, _start_R, rival: Pose) -> float:
            rival.R[:], rival.t[:] = np.eye(3), (AHEAD, UP)[len(waiting) % 2]
            return waiting.pop(0)

        monkeypatch.setattr(competing_motions, "likeliest_other_mode", nearest)
        found = competing_motions.likelier_in_other_direction(fit, lambda: pure_rotation_of(fit))
        assert not waiting
        return found

    return run


def test_the_less_likely_motion_is_the_competing_one(fit, elsewhere):
    best, other = elsewhere(5.0)
    assert best is fit
    assert other.log_ratio == 5.0
    np.testing.assert_array_equal(other.direction_cam1_from_cam0, UP)


def test_without_another_mode_nothing_competes(fit, elsewhere):
    assert elsewhere(np.inf) == (fit, None)


def test_a_likelier_motion_is_taken_and_compared_again(unlikely, elsewhere):
    best, other = elsewhere(-9.0, 12.0, fit=unlikely)
    assert best is not unlikely
    assert other.log_ratio == 12.0


def test_one_that_all_matches_make_less_likely_is_not_taken(fit, elsewhere):
    best, other = elsewhere(-9.0)
    assert best is fit
    assert other.log_ratio == 0.0
    np.testing.assert_array_equal(other.direction_cam1_from_cam0, UP)


def test_where_each_is_likelier_than_the_last_there_is_no_telling(monkeypatch, unlikely, elsewhere):
    monkeypatch.setattr(
        competing_motions,
        "refit_general_motion",
        lambda _, start: replace(start, cost=start.cost - 1),
    )
    _, other = elsewhere(-9.0, -9.0, -9.0, fit=unlikely)
    assert other.log_ratio == 0.0


def test_a_plain_motion_has_no_competing_mode(fit):
    best, other = competing_motions.likelier_in_other_direction(fit, lambda: pure_rotation_of(fit))
    assert best is fit
    assert other is None or other.log_ratio > 20.0


@pytest.fixture
def likelier_of_given(monkeypatch):
    """`likelier_of_search` with a given log-likelihood ratio of ``than`` to its secondary mode."""

    def run(against: float, than: GeneralMotionFit):
        monkeypatch.setattr(competing_motions, "compare_with_mode", lambda *_: against)
        return competing_motions.likelier_of_search(replace(than, secondary_mode=(np.eye(3), UP)))

    return run


def is_same_way(one: GeneralMotionFit | CompetingMotion, other: GeneralMotionFit) -> bool:
    return np.array_equal(one.direction_cam1_from_cam0, other.direction_cam1_from_cam0)


def test_a_secondary_mode_of_the_search_is_compared(fit, unlikely, likelier_of_given):
    best, other = likelier_of_given(5.0, than=fit)
    assert is_same_way(best, fit)
    assert other.log_ratio == 5.0
    np.testing.assert_array_equal(other.direction_cam1_from_cam0, UP)
    best, other = likelier_of_given(-5.0, than=unlikely)
    assert not is_same_way(best, unlikely)
    assert other.log_ratio == 5.0
    assert is_same_way(other, unlikely)
    assert likelier_of_given(np.inf, than=unlikely)[1] is None
    assert competing_motions.likelier_of_search(replace(fit, secondary_mode=None))[1] is None


def test_one_that_all_matches_make_far_likelier_is_taken_against_residuals(
    unlikely, likelier_of_given, monkeypatch
):
    far_likelier = replace(unlikely, direction_cam1_from_cam0=UP, cost=unlikely.cost - 1e3)
    monkeypatch.setattr(competing_motions, "refit_general_motion", lambda *_: far_likelier)
    best, other = likelier_of_given(5.0, than=unlikely)
    assert not is_same_way(best, unlikely)
    # The two contradict each other.
    assert is_same_way(other, unlikely)
    assert other.log_ratio == 0.0


@pytest.mark.parametrize(
    ("matches", "against", "is_asked"),
    [(110, 27.0, True), (110, 28.0, False), (400, 59.0, True), (400, 61.0, False)],
)
def test_what_residuals_rule_out_is_not_asked_again(
    unlikely, likelier_of_given, monkeypatch, matches, against, is_asked
):
    rows = np.resize(np.arange(110), matches)
    many = replace(
        unlikely, matches=unlikely.matches.select(rows), per_match=unlikely.per_match[:, rows]
    )
    asked = []
    monkeypatch.setattr(
        competing_motions, "refit_general_motion", lambda _, start: asked.append(1) or start
    )
    _, other = likelier_of_given(against, than=many)
    assert len(asked) == is_asked
    if not is_asked:
        assert other.log_ratio == against


def likelier_of(fit: GeneralMotionFit, other: CompetingMotion, gain: float, **there):
    """`_likelier`, if all matches make the other motion likelier by as much."""
    plain = replace(fit, cost=0.0, laplace_factor=0.0, per_match=np.ones_like(fit.per_match))
    there = {"direction_cam1_from_cam0": UP, "cost": -gain / len(fit.matches), **there}
    found = replace(plain, **there)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(competing_motions, "refit_general_motion", lambda *_: found)
        best, left = competing_motions._likelier(plain, other)
    return best is found, left


@pytest.mark.parametrize(
    ("because", "has_shrunk_flow", "in_doubt_from", "taken_from"),
    [
        (ELSEWHERE, False, 0.0, 5.0),
        (ELSEWHERE, True, 8.0, 13.0),
        (PLANE, False, 0.0, 13.0),
        (PLANE, True, 8.0, 21.0),
    ],
)
def test_all_matches_must_outweigh_half_of_what_residuals_have_against_a_motion(
    fit, because, has_shrunk_flow, in_doubt_from, taken_from
):
    """And more, where its flow is mostly noise, and of a plane."""
    other = CompetingMotion(np.eye(3), UP, 10.0, because)
    for gain, expected in (
        (in_doubt_from - 0.1, (False, 10.0)),
        (in_doubt_from + 0.1, (False, 0.0)),
        (taken_from - 0.1, (False, 0.0)),
        (taken_from + 0.1, (True, 0.0)),
    ):
        is_taken, left = likelier_of(fit, other, gain, has_shrunk_flow=has_shrunk_flow)
        assert (is_taken, left.log_ratio) == expected


def test_what_residuals_of_doubtful_noise_rule_out_may_still_be_right(fit):
    """Of 110 matches, of each of which a quarter of a unit is heard; four times that in doubt."""
    doubtful = replace(fit, matches=replace(fit.matches, misspecification=4.0))
    for given, against, is_asked in (
        (fit, 27.0, True),
        (fit, 28.0, False),
        (doubtful, 109.0, True),
        (doubtful, 111.0, False),
    ):
        other = CompetingMotion(np.eye(3), UP, against, ELSEWHERE)
        assert likelier_of(given, other, 1e3)[0] == is_asked


@pytest.mark.parametrize(("sign_log_odds", "is_taken"), [(20.0, True), (-20.0, False)])
def test_one_that_would_have_most_matches_behind_the_cameras_is_not_the_likelier(
    fit, sign_log_odds, is_taken
):
    other = CompetingMotion(np.eye(3), UP, 5.0, ELSEWHERE)
    assert likelier_of(fit, other, 15.0, sign_log_odds=sign_log_odds)[0] == is_taken


@pytest.mark.parametrize(
    ("gain", "because", "is_taken"),
    [
        (1.0, ELSEWHERE, True),
        (-1.0, ELSEWHERE, False),
        (-1.0, PLANE, True),
        (-20.0, PLANE, False),
    ],
)
def test_the_relief_of_a_plane_is_believed_unless_matches_are_clearly_against_it(
    fit, gain, because, is_taken
):
    other = CompetingMotion(np.eye(3), UP, -5.0, because)
    found, left = likelier_of(fit, other, gain)
    assert found == is_taken
    assert left.log_ratio == (5.0 if is_taken else 0.0)


def test_matches_of_one_surface_do_not_each_tell_where_they_lie(fit):
    """All that is plausible of them counts as of 5 sqrt(110) matches, of 110."""
    other = CompetingMotion(np.eye(3), UP, 10.0, ELSEWHERE)
    for gain, is_taken in ((11.0, True), (10.0, False)):
        said = np.ones_like(fit.per_match)
        said[0] = np.exp(gain / 110)
        assert likelier_of(fit, other, gain, per_match=said)[0] == is_taken


def test_the_covariance_by_a_competing_rotation_is_largest_about_the_axis_between_them(fit):
    turn = np.radians([0.3, -0.2, 0.1])
    R = so3.exp(turn) @ fit.R_cam1_from_cam0
    doubt = CompetingMotion(R, UP, 0.0, "").rotation_covariance_beside(fit)
    values, axes = np.linalg.eigh(doubt)
    square = turn @ turn
    # The mean square error is that of two that are as likely.
    assert np.trace(doubt) == pytest.approx(0.5 * square)
    np.testing.assert_allclose(values[:2], 0.5 * 0.1 / 3.0 * square)
    assert abs(axes[:, 2] @ turn) == pytest.approx(np.sqrt(square))


def test_the_covariance_grows_with_the_odds_of_a_competing_rotation(fit):
    R = so3.exp(np.radians([0.3, -0.2, 0.1])) @ fit.R_cam1_from_cam0

    def doubt(against):
        return np.trace(CompetingMotion(R, UP, against, "").rotation_covariance_beside(fit))

    # Half of a log likelihood counts: one of ten.
    assert doubt(2.0 * np.log(9.0)) == pytest.approx(doubt(0.0) / 5.0)
    # Where the noise was told, its variance may be four times what was said.
    rival = CompetingMotion(R, UP, 8.0 * np.log(9.0), "")
    assert rival.probability(4.0) == pytest.approx(0.1)


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
        if "allows two motions" in pose.reason and pose.status is PoseStatus.ROTATION_ONLY
    ]


def test_rotations_with_a_competing_mode_lie_within_their_covariances(ambiguous):
    nees = []
    for scene, pose in ambiguous:
        error = rotation_error(pose, scene.rotation_cam1_from_cam0)
        nees.append(error @ np.linalg.solve(pose.rotation_covariance, error))
    # 0.98 and 0.90; without the doubt 0.85 and 0.65.
    assert len(nees) > 60
    assert np.mean(np.array(nees) < chi2.ppf(0.95, 3)) > 0.92
    assert 0.75 < np.mean(np.array(nees) < chi2.ppf(0.68, 3)) < 0.95


@pytest.mark.parametrize("looks_elsewhere", [True, False])
def test_two_modes_stay_possible_with_misspecified_noise(monkeypatch, looks_elsewhere):
    """The same noise told of all matches is no more than what is assumed, but may be wrong."""
    if not looks_elsewhere:  # those that were likelier_of_given are still known
        monkeypatch.setattr(
            competing_motions, "likelier_in_other_direction", lambda fit, _: (fit, None)
        )
    told = np.tile(np.eye(2), (40, 1, 1))
    firm, doubted, because = 0, 0, 0
    for seed in range(60):
        drawn = point_scene(
            seed, matches=40, outliers=0, far_share=0.0, translation_m=(0.02, 0.015, 0.01)
        )
        poses = [
            estimate(drawn),
            estimate(drawn, covariance0_px2=told, covariance1_px2=told),
        ]
        firm += poses[0].status is PoseStatus.OK
        doubted += poses[1].status is PoseStatus.OK
        because += "Secondary mode" in poses[1].reason
    # 60 are firm; 13 are doubted, and 6 of those that were likelier_of_given alone.
    assert firm >= 57
    assert because >= (9 if looks_elsewhere else 4)
    assert doubted <= firm - because


@pytest.mark.parametrize("seed", [0, 2])
def test_a_likelier_secondary_mode_replaces_the_motion(monkeypatch, seed):
    """Also where no noise is told, and the one that was found is sure of itself."""
    search = two_views.fit_general_motion

    def lost(matches, tolerance, options, state):
        found = search(matches, tolerance, options, state)
        R, t = found.R_cam1_from_cam0, found.direction_cam1_from_cam0
        twin = np.empty((3, 3)), np.empty(3)
        bas_relief_motion(matches.pairs, len(matches), 3.0 * found.noise.sigma, R, t, *twin)
        start = replace(found, R_cam1_from_cam0=twin[0], direction_cam1_from_cam0=twin[1])
        wrong = refit_general_motion(matches, start)
        assert wrong.direction_cam1_from_cam0 @ t < -0.9
        return replace(wrong, secondary_mode=(R, t))

    drawn = point_scene(seed, matches=90, outliers=10, translation_m=(0.02, 0.01, 0.0))
    expected = estimate(drawn).direction_cam1_from_cam0
    monkeypatch.setattr(two_views, "fit_general_motion", lost)
    pose = estimate(drawn)
    assert pose.status is PoseStatus.OK
    np.testing.assert_allclose(pose.direction_cam1_from_cam0, expected, atol=0.01)
