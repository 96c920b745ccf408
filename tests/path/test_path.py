"""Motions on one scale: right, as sure as stated, and whole where they can be."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from drive_kit import Cloud, Drive, cloud, forward, motion_of, poses_of

from farpoint import PoseStatus, RelativePose
from farpoint.errors import InputError
from farpoint.path.options import LensRefinementOptions, PathOptions
from farpoint.path.point import PathPoint


def build(scene: Cloud, options: PathOptions | None = None) -> Drive:
    drive = Drive(options)
    for tracks in scene.tracks():
        drive.add(tracks)
    return drive.finish()


def lengths(poses: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)


def log_errors(points: list[PathPoint], poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the logarithms of the lengths over that of the first, and their 1-sigmas."""
    scale = np.array([point.scale for point in points[1:]], float)
    sigma = np.array([point.scale_sigma for point in points[1:]], float)
    true = lengths(poses)
    return np.log(scale / scale[0]) - np.log(true / true[0]), sigma / scale


def test_without_noise_the_path_is_exact():
    poses = poses_of(forward(40), np.tile([0.0, 0.01, 0.0], (40, 1)))
    drive = build(cloud(poses, noise_px=0.0), PathOptions(max_tracks=400))
    unit = lengths(poses)[0]
    for told in (drive.points, drive.settled):
        found = np.array([point.world_from_cam for point in told])
        np.testing.assert_allclose(found[:, :3, 3], poses[:, :3, 3] / unit, rtol=0.0, atol=8e-3)
    assert drive.points[1].scale == pytest.approx(1.0, rel=1e-6)
    assert drive.points[1].scale_sigma == 0.0
    assert {point.segment for point in drive.points} == {0}


def test_every_frame_gets_its_pose_once_in_order():
    poses = poses_of(forward(40), np.zeros((40, 3)))
    drive = build(cloud(poses, count=4000))
    assert [pose.frame1 for pose in drive.settled] == list(range(41))
    np.testing.assert_allclose([pose.timestamp for pose in drive.settled], 0.1 * np.arange(41))
    # Nothing waits for the end: poses are told when their keyframe leaves.
    again = Drive()
    for tracks in cloud(poses, count=4000).tracks():
        again.add(tracks)
    assert 0 < len(again.settled) < 41


@pytest.fixture(scope="module")
def many_drives() -> list[tuple[list[PathPoint], np.ndarray]]:
    drives = []
    for seed in range(40):
        turns = np.random.default_rng(seed).normal(0.0, 0.01, (25, 3))
        poses = poses_of(forward(25, seed=seed), turns)
        drives.append((build(cloud(poses, seed=seed, noise_px=0.15)).points, poses))
    return drives


def test_the_scale_is_as_sure_as_stated(many_drives):
    z = np.array([e[1:] / s[1:] for e, s in (log_errors(*drive) for drive in many_drives)])
    covered = np.mean(np.abs(z) < 1.96)
    # The covariances of motions allow for noise that tracks share; these share none.
    assert covered > 0.88
    # No bias: the errors of the drives are independent.
    assert abs(np.mean(z[:, -1])) < 3.0 / math.sqrt(len(z)) * np.std(z[:, -1])


def test_the_path_is_as_sure_as_stated(many_drives):
    nees = []
    for points, poses in many_drives:
        unit = lengths(poses)[0]
        last, true = points[-1], poses[-1]
        error = true[:3, 3] / unit - last.world_from_cam[:3, 3]
        nees.append(error @ np.linalg.solve(last.covariance[3:6, 3:6], error))
    # 3 degrees of freedom: positions far from the first keyframe are up to 1.7 times as far off as
    # stated, since derivatives are taken where noisy estimates are.
    assert 0.5 < np.mean(nees) < 12.0


def test_moving_objects_do_not_change_the_scale():
    poses = poses_of(forward(40), np.zeros((40, 3)))
    scene = cloud(poses, noise_px=0.1)
    velocity = np.zeros_like(scene.points)
    moving = np.random.default_rng(4).random(len(velocity)) < 0.2
    velocity[moving] = [0.0, 0.0, -0.25]  # towards the camera: along its flow
    scene.velocity = velocity
    errors, _ = log_errors(build(scene).points, poses)
    assert np.abs(errors).max() < 0.04


def test_slow_motion_is_measured_from_a_keyframe():
    steps = np.tile([0.004, 0.0, 0.0], (120, 1))
    poses = poses_of(steps, np.zeros((120, 3)))
    points = build(cloud(poses, count=6000, noise_px=0.1)).points
    found = np.array([point.world_from_cam[:3, 3] for point in points])
    assert {point.segment for point in points} == {0}
    # A step moves the points by a fifth of a pixel; over a hundred of them the way is known.
    displacement, half = found[-1] - found[20], found[70] - found[20]
    assert np.linalg.norm(displacement) / np.linalg.norm(half) == pytest.approx(2.0, rel=0.06)
    assert math.degrees(math.acos(abs(displacement[0]) / np.linalg.norm(displacement))) < 1.5


def test_turning_on_the_spot_carries_the_scale_across():
    steps = np.concatenate([forward(15), np.zeros((10, 3)), forward(15, seed=1)])
    turns = np.zeros((40, 3))
    turns[15:25, 1] = math.radians(2.0)
    poses = poses_of(steps, turns)
    points = build(cloud(poses, count=3000, noise_px=0.1)).points
    still = np.array([point.world_from_cam[:3, 3] for point in points[15:26]])
    assert np.abs(still - still[0]).max() < 0.01  # of the first step
    assert {point.segment for point in points} == {0}
    scale = np.array([point.scale or np.nan for point in points[1:]])
    ratio = scale / lengths(poses).clip(1e-9) * lengths(poses)[0]
    assert abs(np.median(ratio[25:]) - np.median(ratio[1:15])) < 0.03


def turned_out_of_view(faster: float, seed: int = 0) -> tuple[list[PathPoint], np.ndarray]:
    """15 motions, a turn by 120 degrees, and 10 motions of another speed."""
    steps = [forward(15, seed=seed), np.zeros((30, 3)), forward(10, faster * 0.5, seed=seed + 1)]
    turns = np.zeros((55, 3))
    turns[15:45, 1] = math.radians(4.0)
    poses = poses_of(np.concatenate(steps), turns)
    return build(cloud(poses, count=3000, noise_px=0.1, seed=seed)).points, poses


def test_turning_until_nothing_known_is_in_view_the_last_speed_carries_the_scale():
    points, poses = turned_out_of_view(1.0)
    assert {point.segment for point in points} == {0}
    assert [k for k, point in enumerate(points) if point.scale_is_guessed] == [46]
    rotated = points[-1].world_from_cam[:3, :3].T @ poses[-1, :3, :3]
    assert math.degrees(math.acos(min(1.0, (np.trace(rotated) - 1.0) / 2.0))) < 0.3
    assert points[46].scale == pytest.approx(points[15].scale, rel=0.05)
    # The guess and all that is measured by it are as unsure as stated; what was before is not.
    for point in points[46:]:
        assert point.scale_sigma / point.scale == pytest.approx(0.5, rel=0.1)
        assert point.covariance[6, 6] == pytest.approx(0.25, rel=0.05)
    assert points[45].covariance[6, 6] < 0.01
    # Lengths after it agree with each other.
    scale = np.array([point.scale for point in points[46:]])
    ratio = scale / lengths(poses)[45:]
    assert np.ptp(np.log(ratio)) < 0.1


@pytest.mark.parametrize("faster", [0.6, 1.6])
def test_a_wrongly_guessed_speed_is_within_its_sigma(faster):
    points, poses = turned_out_of_view(faster, seed=3)
    unit = lengths(poses)[0]
    error = poses[-1, :3, 3] / unit - points[-1].world_from_cam[:3, 3]
    nees = error @ np.linalg.solve(points[-1].covariance[3:6, 3:6], error)
    assert np.linalg.norm(error) > 1.0
    assert nees < 11.3  # 99 % of chi-square, 3 degrees of freedom


def test_standing_still_nothing_wanders():
    steps = np.concatenate([forward(15), np.zeros((60, 3)), forward(10, seed=1)])
    poses = poses_of(steps, np.zeros((85, 3)))
    points = build(cloud(poses, count=3000, noise_px=0.1)).points
    still = np.array([point.world_from_cam[:3, 3] for point in points[15:76]])
    assert np.linalg.norm(still - still[0], axis=1).max() < 0.01  # of the first step
    assert {point.segment for point in points} == {0}
    errors, _ = log_errors(points[:16], poses[:16])
    scale = np.array([point.scale for point in points[76:]])
    later = np.log(scale / lengths(poses)[75:] * lengths(poses)[0])
    assert abs(np.median(later) - np.median(errors)) < 0.03


def test_a_break_begins_a_segment_where_the_last_one_ended():
    poses = poses_of(forward(6), np.zeros((6, 3)))
    drive = Drive()
    pairs = list(cloud(poses).tracks())
    for tracks in pairs[:3]:
        end = drive.add(tracks)
    broken = drive.builder.break_off()
    assert broken.segment == 1
    np.testing.assert_array_equal(broken.world_from_cam, end.world_from_cam)
    np.testing.assert_array_equal(broken.covariance, np.zeros((7, 7)))
    after = drive.add(pairs[4])
    assert after.segment == 1
    assert after.scale == pytest.approx(end.scale, rel=0.1)  # the speed goes on
    assert after.scale_sigma == 0.0
    settled = drive.finish().settled
    assert [pose.segment for pose in settled] == [0, 0, 0, 0, 1]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("keyframes", 2),
        ("keyframe_flow_px", 0.0),
        ("keyframe_share", 1.5),
        ("max_tracks", 5),
        ("speed_ratio_sigma", math.inf),
    ],
)
def test_options_out_of_their_range_are_refused(name, value):
    with pytest.raises(InputError, match=name):
        PathOptions(**{name: value})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("focal_sigma", 0.0),
        ("center_sigma_px", -1.0),
        ("distortion_sigma_px", math.nan),
        ("readout_ms", -1.0),
        ("readout_ms", 1e9),
    ],
)
def test_options_of_the_lens_out_of_their_range_are_refused(name, value):
    with pytest.raises(InputError, match=name):
        LensRefinementOptions(**{name: value})


def test_a_translation_that_known_points_deny_moves_the_camera_as_far_as_these_say():
    steps = np.concatenate([forward(8), np.zeros((1, 3)), forward(4, seed=1)])
    poses = poses_of(steps, np.zeros((13, 3)))
    pairs = list(cloud(poses, count=3000, noise_px=0.1).tracks())
    drive = Drive()
    for tracks in pairs[:8]:
        before = drive.add(tracks)
    # A false alarm: ahead, by a camera that all but stands. Points shrink as they do half a
    # hundredth of a step back.
    lie = dataclasses.replace(
        motion_of(pairs[7]),
        rotation_cam1_from_cam0=np.eye(3),
        labels=np.full(len(pairs[8]), 2, np.uint8),
    )
    still = dataclasses.replace(pairs[8], points1=pairs[8].points0 * 0.9995 + 0.15)
    point = drive.add(still, lie)
    assert point.segment == 0
    displacement = point.world_from_cam[:3, 3] - before.world_from_cam[:3, 3]
    assert np.linalg.norm(displacement) < 0.02
    assert displacement[2] < 0.0
    for tracks in pairs[9:]:
        after = drive.add(tracks)
    assert after.segment == 0


def test_known_points_tell_that_the_camera_stands_before_something_that_moves():
    steps = np.concatenate([forward(12), np.zeros((6, 3))])
    scene = cloud(poses_of(steps, np.zeros((18, 3))), count=3000, noise_px=0.05)
    drive = Drive()
    for k, tracks in enumerate(scene.tracks()):
        if k < 12:
            drive.add(tracks)
            continue
        # A thing that nobody has seen before covers a part of the image, and moves across it.
        rng = np.random.default_rng(k)
        x = rng.uniform([100.0, 150.0], [300.0, 350.0], (120, 2))
        joined = dataclasses.replace(
            tracks,
            ids=np.concatenate([tracks.ids, 10**6 * (k + 1) + np.arange(120)]),
            points0=np.concatenate([tracks.points0, x]),
            points1=np.concatenate([tracks.points1, rng.normal(x + np.array([6.0, 0.5]), 0.05)]),
            covariance_px2=np.tile(0.05**2 * np.eye(2), (len(tracks) + 120, 1, 1)),
        )
        moving = motion_of(joined)
        lie = dataclasses.replace(
            motion_of(list(scene.tracks())[5]),
            rotation_cam1_from_cam0=np.eye(3),
            labels=np.where(np.arange(len(joined)) < len(tracks), 1, 2).astype(np.uint8),
        )
        told = moving if moving.status is PoseStatus.OK else lie
        point = drive.add(joined, told)
        assert point.rest is not None
        assert point.scale is None
        assert set(tracks.ids) & set(point.fitting)
        assert not (set(point.fitting) & set(joined.ids[len(tracks) :]))
    at = np.array([p.world_from_cam[:3, 3] for p in drive.points[12:]])
    assert np.linalg.norm(at - at[0], axis=1).max() < 0.02


def test_a_wrong_first_motion_is_replaced_by_one_of_longer_flow():
    poses = poses_of(forward(30, length=0.1), np.zeros((30, 3)))
    pairs = list(cloud(poses, count=3000, noise_px=0.1).tracks())
    first = motion_of(pairs[0])
    basis = first.direction_basis
    wrong = dataclasses.replace(
        first,
        # To the side, and a turn that makes up for most of the flow.
        direction_cam1_from_cam0=basis[:, 0],
        direction_basis=np.column_stack([first.direction_cam1_from_cam0, basis[:, 1]]),
    )
    errors = []
    for start in (first, wrong):
        drive = Drive()
        drive.add(pairs[0], start)
        for tracks in pairs[1:]:
            drive.add(tracks)
        found = np.array([point.world_from_cam[:3, 3] for point in drive.points[10:]])
        found, true = found - found[0], poses[10:31, :3, 3] - poses[10, :3, 3]
        scale = np.sum(found * true) / np.sum(true**2)
        errors.append(np.linalg.norm(found - scale * true, axis=1).max() / scale)
    assert errors[0] < 0.02
    assert errors[1] < 2.0 * errors[0] + 0.01


def test_a_restart_corrects_the_poses_before_it_and_keeps_the_error_of_the_scale():
    poses = poses_of(forward(24, length=0.1), np.zeros((24, 3)))
    pairs = list(cloud(poses, count=3000, noise_px=0.3).tracks())
    first = motion_of(pairs[0])
    basis = first.direction_basis
    wrong = dataclasses.replace(
        first,
        direction_cam1_from_cam0=basis[:, 0],
        direction_basis=np.column_stack([first.direction_cam1_from_cam0, basis[:, 1]]),
    )
    true = poses[:, :3, 3]
    drive = Drive()
    drive.add(pairs[0], wrong)
    drive.builder._base[6, 6] = 0.25  # as after a guess
    for tracks in pairs[1:]:
        drive.add(tracks)
    drive.finish()
    assert drive.builder._base[6, 6] == 0.25
    told = np.array([point.world_from_cam[:3, 3] for point in drive.points])
    found = np.array([pose.world_from_cam[:3, 3] for pose in drive.settled])
    scale = np.sum(found * true) / np.sum(true**2)
    off, corrected = (np.linalg.norm(p - scale * true, axis=1)[:6] / scale for p in (told, found))
    assert off[1] > 0.03  # of a way of 0.1
    assert corrected.max() < 0.015


def test_before_a_length_is_known_nobody_knows_where_the_camera_is():
    poses = poses_of(np.zeros((6, 3)), np.tile([0.0, 0.02, 0.0], (6, 1)))
    drive = build(cloud(poses))
    assert {point.scale for point in drive.points} == {None}
    sigmas = [np.sqrt(np.linalg.eigvalsh(p.covariance[3:6, 3:6])[0]) for p in drive.points]
    assert sigmas[0] == 0.0
    assert min(sigmas[1:]) >= 2.0
    assert (np.diff(sigmas) > 0.0).all()
    still = build(cloud(poses_of(np.zeros((6, 3)), np.zeros((6, 3)))))
    assert not any(point.covariance[3:6, 3:6].any() for point in still.points)


def test_a_camera_at_rest_is_not_estimated_since_its_keyframe_again_and_again():
    scene = cloud(poses_of(np.zeros((30, 3)), np.zeros((30, 3))))
    drive, calls = Drive(), []
    estimate = drive.builder._estimate

    def counted(*arguments: object) -> RelativePose:
        calls.append(arguments)
        return estimate(*arguments)

    drive.builder._estimate = counted
    for tracks in scene.tracks():
        drive.add(tracks)
    # Noise adds up along tracks, so that their flow grows with the root of time: by 1.25 in 56 %.
    assert 0 < len(calls) < 15
