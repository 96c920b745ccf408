"""What can be observed is said, and what cannot is None: the verdicts and their words."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from pose_kit import assert_sound, direction_error, estimate, point_scene, rotation_error
from scipy.stats import f as f_distribution

from farpoint import (
    PoseStatus,
    RelativePose,
    RelativePoseOptions,
    TrackLabel,
    estimate_relative_pose,
)
from farpoint.camera import Pinhole
from farpoint.geometry import so3
from farpoint.pose import failed_pose
from farpoint.pose.constants import INDEPENDENT_TESTS
from farpoint.pose.general_motion import GeneralMotionFit, fit_general_motion
from farpoint.pose.matches import matches_from_points
from farpoint.pose.model_selection import is_motion, is_static, translation_evidence
from farpoint.synthetic import PointScene, paper_camera

STILL = (0.0, 0.0, 0.0)
INFINITE = (np.inf, np.inf)


def statuses(poses: list[RelativePose]) -> dict[PoseStatus, int]:
    return {status: sum(pose.status is status for pose in poses) for status in PoseStatus}


def run(count: int, options: RelativePoseOptions | None = None, **scene) -> list[RelativePose]:
    poses = []
    for seed in range(count):
        drawn = point_scene(seed, **scene)
        poses.append(estimate(drawn, options=options))
        assert_sound(poses[-1], len(drawn.points0))
    return poses


def last_scene(count: int, **scene) -> PointScene:
    return point_scene(count - 1, **scene)


@pytest.mark.parametrize("outliers", [0, 20])
def test_a_camera_that_only_turns(outliers):
    scene = {"outliers": outliers, "translation_m": STILL}
    poses = run(60, **scene)
    # One false alarm in a thousand: two in sixty have a chance of 0.2 %.
    assert statuses(poses)[PoseStatus.ROTATION_ONLY] >= 59
    error = rotation_error(poses[-1], last_scene(60, **scene).rotation_cam1_from_cam0)
    assert error @ np.linalg.solve(poses[-1].rotation_covariance, error) < 16.3  # 99.9 %
    assert "Pure rotation" in poses[0].reason


@pytest.mark.parametrize("outliers", [0, 20])
def test_a_camera_that_stands_still(outliers):
    scene = {"outliers": outliers, "translation_m": STILL, "rotation_vector_rad": STILL}
    poses = run(60, **scene)
    assert statuses(poses)[PoseStatus.STATIC] >= 59
    error = rotation_error(poses[-1], np.eye(3))
    assert error @ np.linalg.solve(poses[-1].rotation_covariance, error) < 16.3
    assert "still" in poses[0].reason


def test_a_camera_that_moves_past_nothing_near():
    poses = run(60, far_share=1.0, far_range_m=INFINITE, translation_m=(0.1, 0.1, 0.3))
    assert statuses(poses)[PoseStatus.ROTATION_ONLY] >= 59
    assert not any((pose.labels == TrackLabel.NEAR).any() for pose in poses[:10])


def test_flow_that_is_mostly_noise_tells_no_direction():
    """All points at about the same distance: the flow is a rotation's but for a hair."""
    given, of_given, refused, of_refused, as_noise = 0, 0, 0, 0, 0
    scene = {"matches": 500, "outliers": 100, "far_share": 1.0}
    for seed in range(120):
        rng = np.random.default_rng(seed)
        translation = rng.normal(size=3)
        translation *= 0.05 / np.linalg.norm(translation)
        drawn = point_scene(seed, translation_m=tuple(translation), **scene)
        pose = estimate(drawn)
        assert_sound(pose, len(drawn.points0))
        error = rotation_error(pose, drawn.rotation_cam1_from_cam0)
        within = error @ np.linalg.solve(pose.rotation_covariance, error) < 7.81
        if pose.status is PoseStatus.OK:
            given, of_given = given + 1, of_given + within
        elif "Pure rotation or" not in pose.reason:
            refused, of_refused = refused + 1, of_refused + within
            as_noise += "mostly noise" in pose.reason
    # Where the flow is not asked for its signal, ten of seventeen that are given are wrong.
    assert of_given >= given - 1
    assert refused >= 40
    assert of_refused >= 0.8 * refused
    assert as_noise >= 5


def test_ten_right_matches_outvote_ten_wrong_ones():
    # Five of any kind fit a motion without noise, and of the others one or two come near it.
    found, right = 0, 0
    for seed in range(60):
        drawn = point_scene(seed, matches=20, outliers=10, far_share=0.0)
        pose = estimate(drawn)
        if pose.status is PoseStatus.OK:
            found += 1
            right += np.linalg.norm(direction_error(pose, drawn.direction_cam1_from_cam0)) < 0.5
    assert found >= 40
    assert right >= 0.95 * found


@pytest.mark.parametrize(
    ("baseline_m", "noise_px", "count", "least"),
    # 0.92 of 25, 0.80 of 97 and 0.92 of 95; 0.80, 0.67 and 0.76 without the odds of a translation.
    [(0.05, 0.22, 20, 0.85), (0.05, 0.5, 60, 0.75), (0.02, 0.22, 60, 0.85)],
)
def test_a_rotation_that_is_taken_for_lack_of_matches_says_that_it_may_be_wrong(
    baseline_m, noise_px, count, least
):
    held = []
    for seed in range(240):
        drawn = point_scene(
            seed,
            matches=20,
            outliers=10,
            far_share=0.0,
            noise_px=noise_px,
            translation_m=(baseline_m, 0.0, 0.0),
        )
        pose = estimate(drawn)
        if pose.reason.startswith("Pure rotation or"):
            error = rotation_error(pose, drawn.rotation_cam1_from_cam0)
            held.append(error @ np.linalg.solve(pose.rotation_covariance, error) < 7.81)
    assert len(held) >= count
    assert np.mean(held) > least


@pytest.mark.parametrize(
    ("count", "sigmas", "translates"),
    [(4, 6.0, False), (4, 12.0, False), (8, 12.0, True), (3, 60.0, False), (12, 60.0, True)],
)
def test_how_far_tracks_are_off_says_how_likely_they_point_to_one_direction(
    count, sigmas, translates
):
    # Of a circle of six sigma, the band of three takes up a sixth on the side of the direction.
    each = np.ones(count)
    fit = SimpleNamespace(
        residual=0.5 * each,
        parallax=sigmas * each,
        noise=SimpleNamespace(mean_sigma=1.0),
        agreeing=0,
    )
    turning = SimpleNamespace(probability=0.0 * each, distance2=sigmas**2 * each)
    assert (
        translation_evidence(SimpleNamespace(misspecification=4.0), fit, turning, 1e-3) == 1.0
    ) is translates


@pytest.mark.parametrize(("narrowness", "shown"), [(20.0, 3.13), (38.0, 0.53), (45.0, 0.0)])
def test_a_translation_is_shown_as_far_as_it_is_likelier_than_a_turn(narrowness, shown):
    # Four right matches in six sigma: too few to be near by more than chance. Each is 98 times as
    # likely right as wrong by the motion, the others as likely by both.
    right = np.repeat([0.99, 0.5], [4, 4])
    noise = SimpleNamespace(mean_sigma=1.0, sigma=1.0, outlier_share=0.5)
    fit = SimpleNamespace(
        residual=0.5 * np.ones(8), parallax=6.0 * np.ones(8), probability=right, agreeing=6,
        noise=noise, per_match=np.ones((4, 8)), matches=SimpleNamespace(outlier_half_width=100.0),
        laplace_factor=narrowness,
    )  # fmt: skip
    turning = SimpleNamespace(
        probability=np.zeros(8), distance2=1e-4 * np.ones(8), noise=noise, laplace_factor=25.0
    )
    found = translation_evidence(
        SimpleNamespace(misspecification=1.0, min_variance=1e-6), fit, turning, 1e-3
    )
    # Half of them may be far; that nine tenths are is as likely, to begin with.
    gain = 4 * math.log(1.0 + 99.0 * 0.5) + 4 * math.log(1.0 + 0.5) - math.log(2.0)
    assert found == pytest.approx(max(gain + 25.0 - narrowness, 0.0) / math.log(1e3), rel=1e-4)
    assert found == pytest.approx(shown, abs=0.02)


@pytest.mark.parametrize(
    ("doubt", "ratio", "shown"),
    [
        *((4.0, *pair) for pair in [(1.1, 0.0), (1.9, 0.0), (3.0, 0.06), (3.9, 0.8), (4.1, 1.0)]),
        *((1.0, *pair) for pair in [(1.1, 0.0), (1.9, 1.0)]),
    ],
)
def test_flow_that_misstated_noise_may_have_made_shows_less_of_a_translation(doubt, ratio, shown):
    # Of 400 matches, `ratio` is the variance towards the direction over that across it.
    each = np.ones(400)
    fit = SimpleNamespace(
        residual=each, parallax=0.0 * each, noise=SimpleNamespace(mean_sigma=1.0), agreeing=0
    )
    turning = SimpleNamespace(probability=each, distance2=(1.0 + ratio) * each)
    found = translation_evidence(
        SimpleNamespace(misspecification=doubt, min_variance=1e-6), fit, turning, 1e-3
    )
    assert found == pytest.approx(shown, abs=0.04)


@pytest.mark.parametrize(
    ("ratio", "shown"), [(2.6, 0.0), (4.1, 0.04), (5.0, 0.2), (7.0, 0.55), (9.0, 0.8), (14.0, 1.0)]
)
def test_flow_shows_a_translation_by_the_digits_of_its_false_alarms(ratio, shown):
    # Of 20 matches, `ratio` is the variance towards the direction over that across it.
    each = np.ones(20)
    fit = SimpleNamespace(
        residual=each, parallax=0.0 * each, noise=SimpleNamespace(mean_sigma=1.0), agreeing=0
    )
    turning = SimpleNamespace(probability=each, distance2=(1.0 + ratio * 20 / 17) * each)
    found = translation_evidence(
        SimpleNamespace(misspecification=1.0, min_variance=1e-6), fit, turning, 1e-3
    )
    false_alarms = INDEPENDENT_TESTS * f_distribution.sf(ratio, 20, 17)
    digits = -math.log10(false_alarms) / 3.0
    assert found == pytest.approx(min(max(digits, 0.0), 1.0))
    assert found == pytest.approx(shown, abs=0.05)


@pytest.mark.parametrize(("noise_px", "least"), [(0.5, 0.93), (1.0, 0.6)])
def test_a_rotation_covers_the_motion_suggested_by_the_flow(noise_px, least):
    held = []
    for seed in range(200):
        options = {"matches": 20, "outliers": 0, "far_share": 0.0, "noise_px": noise_px}
        drawn = point_scene(seed, translation_m=(0.02, 0.0, 0.0), **options)
        pose = estimate(drawn)
        if pose.status is not PoseStatus.FAILED:
            error = rotation_error(pose, drawn.rotation_cam1_from_cam0)
            held.append(error @ np.linalg.solve(pose.rotation_covariance, error) < 7.81)
    assert len(held) > 190
    assert np.mean(held) > least


def test_weak_evidence_for_a_motion_without_a_rotation_leaves_the_pure_rotation(monkeypatch):
    options = {"matches": 20, "outliers": 0, "far_share": 0.0, "noise_px": 1.0}
    drawn = [point_scene(seed, translation_m=(0.02, 0.0, 0.0), **options) for seed in range(40)]
    turned = [scene for scene in drawn if "Pure rotation or" in estimate(scene).reason]
    assert len(turned) > 20
    unsure = np.full((5, 5), np.inf)
    monkeypatch.setattr(GeneralMotionFit, "averaged_covariance", unsure)
    for scene in turned:
        assert "Pure rotation or" in estimate(scene).reason


def test_a_rotation_with_weak_evidence_for_translation_covers_both_motions():
    # As long a flow as noise told a little too small might have made.
    squares = []
    for seed in range(30):
        drawn = point_scene(
            seed, matches=400, translation_m=(0.002, 0.0, 0.0), near_range_m=(1.0, 2.0)
        )
        told = np.broadcast_to(drawn.noise_px**2 * np.eye(2), (400, 2, 2))
        pose = estimate(drawn, covariance1_px2=told)
        if pose.status is PoseStatus.ROTATION_ONLY:
            error = rotation_error(pose, drawn.rotation_cam1_from_cam0)
            squares.append(error @ np.linalg.solve(pose.rotation_covariance, error))
    assert len(squares) >= 15
    # Of three degrees of freedom: it is 11, and without the other motion 200.
    assert np.median(squares) < 30.0


@pytest.mark.parametrize(("matches", "samples"), [(8, 39), (9, 88)])
def test_of_few_matches_no_more_samples_are_tried_than_show_half_of_all(matches, samples):
    options = {"matches": matches, "outliers": 1, "translation_m": (0.2, 0.0, 0.0)}
    tried = [pose.stats.iterations for pose in run(120, **options)]
    assert max(tried) == samples


@pytest.mark.parametrize("far_share", [0.0, 0.5])
def test_ten_right_matches_of_twenty_are_a_consensus(far_share):
    options = {"matches": 20, "outliers": 10, "far_share": far_share, "noise_px": 0.5}
    poses = run(60, translation_m=(0.2, 0.0, 0.0), **options)
    # Counting those that agree, with as many that may by chance, 30 to 50 of 60 failed.
    assert statuses(poses)[PoseStatus.FAILED] <= 8


@pytest.mark.parametrize(
    ("agreeing", "more", "is_one"), [(6, 0.1, True), (6, -0.1, False), (5, 9.0, False)]
)
def test_a_motion_is_a_thousand_times_likelier_than_wrong_matches(agreeing, more, is_one):
    likelier = math.log(1000.0) + 30.0 + more
    fit = SimpleNamespace(agreeing=agreeing, log_odds=likelier, laplace_factor=30.0)
    assert is_motion(fit, 1e-3) is is_one


@pytest.mark.parametrize("count", [8, 10, 14, 20, 50])
def test_hardly_ever_is_a_motion_likelier_than_wrong_matches_alone(count):
    rng, camera = np.random.default_rng(count), paper_camera()
    found = 0
    for _ in range(400):
        points = rng.uniform((0.0, 0.0), camera.size, (2, count, 2))
        matches = matches_from_points(*points, camera, camera)
        fit = fit_general_motion(matches, 1.5, RelativePoseOptions(), np.zeros(1, np.uint64))
        # A hundred times the rate of the estimator: what chance does is seen in fewer trials.
        found += is_motion(fit, 0.1)
    assert found <= 40


def test_a_direction_with_a_competing_mode_is_not_given():
    # Noise as long as the flow: a rotation takes the place of the translation, which turns round.
    wrong, given, rivals = 0, 0, 0
    for seed in range(600):
        drawn = point_scene(
            seed, matches=90, outliers=18, noise_px=1.0, translation_m=(0.02, 0.0, 0.0)
        )
        pose = estimate(drawn)
        rivals += pose.reason.startswith("Secondary mode")
        if pose.status is PoseStatus.OK:
            given += 1
            wrong += pose.direction_cam1_from_cam0 @ drawn.direction_cam1_from_cam0 < 0.0
    assert rivals >= 60
    assert given >= 150
    # 24 of 383, and 97 of 485 if rivals are not looked for. One in ten would be seen here 19 times
    # in 20.
    assert wrong <= 0.075 * given


def test_wrong_matches_alone_are_no_consensus():
    poses = run(40, outliers=110)
    assert statuses(poses)[PoseStatus.FAILED] == 40
    assert poses[0].reason.startswith("No consensus")
    assert all((pose.labels == TrackLabel.OUTLIER).all() for pose in poses)


@pytest.mark.parametrize(
    "scene",
    [
        {},
        {"outliers": 0},
        {"far_share": 0.0},
        {"translation_m": (0.2, 0.0, 0.0)},
        {"noise_px": 1.0, "far_share": 0.2},
        {"matches": 300, "outliers": 150},
    ],
    ids=["default", "no outliers", "no far", "sideways", "noisy", "half wrong"],
)
def test_a_camera_that_moves_is_seen_to_move(scene):
    assert statuses(run(20, **scene))[PoseStatus.OK] == 20


def test_the_closed_form_has_the_same_verdicts():
    options = RelativePoseOptions(refine=False)
    assert statuses(run(10, options, far_range_m=INFINITE))[PoseStatus.OK] == 10
    turned = run(10, options, translation_m=STILL)
    assert statuses(turned)[PoseStatus.ROTATION_ONLY] == 10
    still = run(10, options, translation_m=STILL, rotation_vector_rad=STILL)
    assert statuses(still)[PoseStatus.STATIC] == 10
    assert statuses(run(10, options, outliers=110))[PoseStatus.FAILED] == 10


@pytest.mark.parametrize("count", range(8))
def test_too_few_matches(count):
    scene = point_scene(0, matches=20, outliers=0)
    pose = estimate_relative_pose(scene.points0[:count], scene.points1[:count], scene.camera)
    assert pose.status is PoseStatus.FAILED
    assert_sound(pose, count)
    assert "few" in pose.reason
    assert str(count) in pose.reason


def test_eight_matches_are_enough_to_try_and_twelve_to_succeed():
    for seed in range(20):
        scene = point_scene(seed, matches=12, outliers=0)
        eight = estimate_relative_pose(scene.points0[:8], scene.points1[:8], scene.camera)
        assert_sound(eight, 8)
        assert "few" not in eight.reason.lower()
        assert estimate(scene).status is PoseStatus.OK


def test_eight_exact_matches_tell_the_motion():
    poses = run(400, matches=8, outliers=0, noise_px=0.0)
    found = statuses(poses)
    # Eight points may all be far; but exact matches agree, so there is a consensus. Of 400 scenes
    # two have none: so few samples are tried of eight that they may all lead elsewhere.
    assert found[PoseStatus.FAILED] <= 3
    assert found[PoseStatus.OK] >= 300


def test_matches_without_a_ray_are_left_out_and_labelled_outliers():
    lens = Pinhole(fx=400.0, fy=400.0, cx=319.5, cy=239.5, distortion=(-0.12, 0.0, 0.0, 0.0))
    camera = replace(paper_camera(), model=lens)
    scene = point_scene(0, camera=camera, matches=60, outliers=0)
    # Beyond the fold of this lens no ray ends.
    points0, points1 = scene.points0.copy(), scene.points1.copy()
    points0[:5] = 5000.0
    assert np.isnan(camera.unproject(points0[:5])).all()
    pose = estimate_relative_pose(points0, points1, camera)
    assert_sound(pose, 60)
    assert pose.status is PoseStatus.OK
    assert (pose.labels[:5] == TrackLabel.OUTLIER).all()
    rest = estimate_relative_pose(points0[5:], points1[5:], camera)
    np.testing.assert_array_equal(pose.rotation_cam1_from_cam0, rest.rotation_cam1_from_cam0)
    np.testing.assert_array_equal(pose.labels[5:], rest.labels)
    few = estimate_relative_pose(points0[:12], points1[:12], camera)
    assert few.status is PoseStatus.FAILED
    assert "7 usable of 12" in few.reason


def test_a_failed_pose_made_by_hand():
    pose = failed_pose("The frame cannot be decoded: it is empty.")
    assert_sound(pose, 0)
    assert pose.status is PoseStatus.FAILED


def test_the_sign_of_the_direction_is_right_wherever_it_is_given():
    wrong = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        step = rng.normal(size=3)
        step *= 0.02 / np.linalg.norm(step)
        scene = point_scene(seed, translation_m=tuple(step), far_range_m=(200.0, 1000.0))
        pose = estimate(scene)
        if pose.status is PoseStatus.OK:
            assert pose.stats.sign_probability > 0.999
            wrong += pose.direction_cam1_from_cam0 @ scene.direction_cam1_from_cam0 < 0.0
    assert wrong == 0


def test_an_error_of_the_given_noise_is_no_translation():
    """Tracks are off along their motion by more than across it, and no tracker says so."""
    rng, told = np.random.default_rng(3), np.tile(np.eye(2), (600, 1, 1))
    noise_px = 0.1 * np.array([np.sqrt(2.0), 1.0])

    def pose_of(scene: PointScene) -> RelativePose:
        noisy = [p + noise_px * rng.normal(size=p.shape) for p in (scene.points0, scene.points1)]
        return estimate_relative_pose(
            *noisy, scene.camera, covariance0_px2=told, covariance1_px2=told
        )

    given = {"matches": 600, "outliers": 0, "noise_px": 0.0}
    turned = [pose_of(point_scene(seed, translation_m=STILL, **given)) for seed in range(20)]
    assert statuses(turned)[PoseStatus.ROTATION_ONLY] == 20
    moved = [pose_of(point_scene(seed, **given)) for seed in range(20)]
    assert statuses(moved)[PoseStatus.OK] == 20


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-9, 0.01, 0.3, 1.5])
def test_a_turn_is_none_where_its_own_covariance_says_so(angle):
    axis = np.array([0.6, -0.48, 0.64])
    R = so3.exp(angle * axis)
    # The 99.9 % quantile of chi-square with three degrees of freedom is 16.27.
    across = np.eye(3) - np.outer(axis, axis)
    for distance2, expected in ((16.2, True), (16.4, False)):
        sigma2 = max(angle, 1e-6) ** 2 / distance2
        covariance = sigma2 * np.outer(axis, axis) + 1e-8 * across
        assert is_static(R, covariance, 1e-3) == (expected or angle < 1e-6)


@pytest.mark.parametrize("angle", [1.6, 3.0, math.pi])
def test_a_large_turn_is_never_none(angle):
    assert not is_static(so3.exp(np.array([angle, 0.0, 0.0])), 0.04 * np.eye(3), 1e-3)
