"""Images in, motions out: what each frame adds, and what bad frames do not take away."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np
import pytest

from boards import CAMERA, HEIGHT, STEP, TURN, WIDTH, drive
from farpoint import (
    Camera,
    Frame,
    Odometry,
    OdometryOptions,
    OdometryResult,
    PoseStatus,
    RelativePose,
    RelativePoseOptions,
    TrackLabel,
)
from farpoint.errors import InputError
from farpoint.geometry import so3, sphere
from farpoint.metrics import evaluate_halves
from farpoint.odometry import sequence
from farpoint.pose import failed_pose
from farpoint.pose.image_parts import parts_of
from farpoint.pose.views import Views
from farpoint.tracks import TrackerOptions

OPTIONS = OdometryOptions(tracker=TrackerOptions(max_tracks=250))
BLACK = np.zeros((HEIGHT, WIDTH), np.uint8)


IMAGES = drive(6)


def frames(images: list[np.ndarray | None]) -> Iterator[Frame]:
    for index, image in enumerate(images):
        fault = "its data are damaged" if image is None else None
        yield Frame(
            index=index, timestamp=10.0 + 0.1 * index, image=image, name=str(index), fault=fault
        )


def run(images: list[np.ndarray | None], camera: Camera = CAMERA) -> list[OdometryResult]:
    return list(Odometry(camera, OPTIONS).run(frames(images)))


def statuses(results: list[OdometryResult]) -> list[str]:
    return ["-" if r.pose is None else r.pose.status.value for r in results]


def compared(results: list[OdometryResult]) -> list[tuple[int, int]]:
    return [(r.frame0, r.frame1) for r in results]


@pytest.fixture(scope="module")
def results() -> list[OdometryResult]:
    return run(list(IMAGES))


def test_the_first_frame_has_nothing_to_be_compared_with(results):
    first = results[0]
    assert first.pose is None
    assert (first.frame0, first.frame1, len(first.tracks)) == (0, 0, 0)
    assert first.scale is None
    np.testing.assert_array_equal(first.world_from_cam, np.eye(4))


def test_every_pair_has_the_motion_that_was_made(results):
    assert statuses(results) == ["-"] + 5 * ["OK"]
    assert compared(results)[1:] == [(k, k + 1) for k in range(5)]
    for result in results[1:]:
        pose = result.pose
        assert result.timestamp0 == pytest.approx(10.0 + 0.1 * result.frame0)
        assert result.timestamp == pytest.approx(10.0 + 0.1 * result.frame1)
        assert math.degrees(so3.angle_between(pose.rotation_cam1_from_cam0, TURN)) < 0.05
        off = sphere.angle_between(pose.direction_cam1_from_cam0, sphere.normalize(STEP))
        assert math.degrees(off) < 2.0
        assert len(result.tracks) == len(pose.labels) > 100


def test_halves_of_the_tracks_of_a_pair_agree_about_its_motion():
    # Halves have the same read-out time: its error is no part of their difference.
    odometry = Odometry(CAMERA.with_readout(0.0), OPTIONS)
    results = list(odometry.run(frames(list(IMAGES))))
    halves = [odometry.split_half(result) for result in results[1:]]
    found = evaluate_halves(halves)
    assert (found.pairs, found.compared) == (5, 5)
    assert found.ratio.ratio < 3.0
    # Each half knows less than all tracks together, so the two differ by more than they err.
    for half, result in zip(halves, results[1:], strict=True):
        assert np.trace(half.covariance) > 2.0 * np.trace(result.pose.covariance)
    again = odometry.split_half(results[3])
    np.testing.assert_array_equal(again.difference, halves[2].difference)
    by_cells = odometry.split_half(results[3], cell_px=40.0)
    assert by_cells.dof == 5
    assert not np.array_equal(by_cells.difference, again.difference)


def test_tracks_that_lie_together_go_to_the_same_half(monkeypatch: pytest.MonkeyPatch):
    odometry = Odometry(CAMERA, OPTIONS)
    result = list(odometry.run(frames(list(IMAGES))))[3]
    halves: list[np.ndarray] = []

    def estimate(views: Views, *_others) -> RelativePose:
        halves.append(views.points0)
        return failed_pose("Not estimated.")

    monkeypatch.setattr(sequence, "estimate_views", estimate)
    odometry.split_half(result)
    first = (result.tracks.points0[:, None] == halves[0]).all(axis=2).any(axis=1)
    assert len(halves[0]) + len(halves[1]) == len(result.tracks)
    part = parts_of(CAMERA.unproject(result.tracks.points0))
    assert len(set(part)) == 16
    assert all(len(set(first[part == k])) == 1 for k in set(part))


def test_what_is_unsure_of_lens_and_shutter_is_not_between_halves(monkeypatch: pytest.MonkeyPatch):
    camera = CAMERA.with_uncertainty(focal=0.01).with_readout(0.01, 0.002)
    odometry = Odometry(camera, OPTIONS)
    result = list(odometry.run(frames(list(IMAGES))))[3]
    cameras = []

    def estimate(views: Views, *_others) -> RelativePose:
        cameras.append(views.camera0)
        return failed_pose("Not estimated.")

    monkeypatch.setattr(sequence, "estimate_views", estimate)
    odometry.split_half(result)
    assert {(c.uncertainty, c.readout_s, c.readout_sigma_s) for c in cameras} == {
        (None, 0.01, None)
    }


def test_what_all_tracks_have_in_common_is_in_the_pose_and_not_between_its_halves():
    plain, shared = (
        Odometry(CAMERA, OdometryOptions(pose=RelativePoseOptions(shared_error_px=error_px)))
        for error_px in (0.0, 0.5)
    )
    images = drive(2)
    first, second = (
        [odometry.process(image, float(k)) for k, image in enumerate(images)][1]
        for odometry in (plain, shared)
    )
    grown = second.pose.covariance - first.pose.covariance
    assert np.linalg.eigvalsh(grown[:3, :3])[0] > 0.0
    halves = plain.split_half(first), shared.split_half(second)
    np.testing.assert_array_equal(halves[0].covariance, halves[1].covariance)


@pytest.mark.parametrize("seed", range(70, 90))
def test_the_motion_is_found_in_every_scene(seed):
    (_, result) = run(drive(2, seed=seed))
    assert result.pose.status is PoseStatus.OK
    assert math.degrees(so3.angle_between(result.pose.rotation_cam1_from_cam0, TURN)) < 0.1


def test_the_wall_is_far_and_the_boards_are_near(results):
    result = results[3]
    # The wall is seen between the boards: its points move by the rotation alone.
    turned = CAMERA.project(CAMERA.unproject(result.tracks.points0) @ TURN.T)
    on_wall = np.linalg.norm(result.tracks.points1 - turned, axis=1) < 0.3
    labels = result.pose.labels
    assert 20 < on_wall.sum() < len(labels) - 20
    assert (labels[on_wall] != TrackLabel.NEAR).mean() > 0.8
    assert (labels[~on_wall] == TrackLabel.NEAR).mean() > 0.8


def test_poses_are_chained_on_one_scale(results):
    for before, result in itertools.pairwise(results):
        motion = np.linalg.inv(result.world_from_cam) @ before.world_from_cam
        turned = so3.angle_between(motion[:3, :3], result.pose.rotation_cam1_from_cam0)
        assert math.degrees(turned) < 0.05
        assert result.scale == pytest.approx(1.0, abs=0.05)
        assert result.segment == 0
    assert results[1].scale == pytest.approx(1.0, rel=1e-3)
    assert results[1].scale_sigma == 0.0
    assert 0.0 < results[5].scale_sigma < 0.06


def test_tracks_keep_their_ids_from_frame_to_frame(results):
    for earlier, later in itertools.pairwise(results[1:]):
        good = earlier.tracks.select(earlier.pose.labels != TrackLabel.OUTLIER)
        common, row0, row1 = np.intersect1d(good.ids, later.tracks.ids, return_indices=True)
        assert len(common) > 0.7 * len(good)
        np.testing.assert_array_equal(good.points1[row0], later.tracks.points0[row1])
        assert len(np.unique(later.tracks.ids)) == len(later.tracks)


def test_a_thing_that_moves_by_itself_is_an_outlier_and_followed_no_longer():
    images = [image.copy() for image in IMAGES[:4]]
    thing = drive(1, seed=9)[0][:90, :90]
    for k, image in enumerate(images):
        image[70 + 2 * k : 160 + 2 * k, 100 + 4 * k : 190 + 4 * k] = thing
    results = run(images)
    assert statuses(results) == ["-", "OK", "OK", "OK"]
    for earlier, later in itertools.pairwise(results[1:]):
        flow = earlier.tracks.points1 - earlier.tracks.points0
        own = np.linalg.norm(flow - [4.0, 2.0], axis=1) < 0.2
        assert own.sum() > 5
        assert (earlier.pose.labels[own] == TrackLabel.OUTLIER).mean() > 0.8
        wrong = earlier.tracks.ids[earlier.pose.labels == TrackLabel.OUTLIER]
        assert not np.isin(wrong, later.tracks.ids).any()


def test_the_same_frames_give_the_same_results_bit_for_bit(results):
    for a, b in zip(results, run(list(IMAGES)), strict=True):
        assert a.world_from_cam.tobytes() == b.world_from_cam.tobytes()
        assert a.tracks.points1.tobytes() == b.tracks.points1.tobytes()
        if a.pose is not None:
            assert a.pose.covariance.tobytes() == b.pose.covariance.tobytes()
            assert a.pose.labels.tobytes() == b.pose.labels.tobytes()


def test_results_come_frame_by_frame():
    given: list[int] = []

    def watched() -> Iterator[Frame]:
        for frame in frames(list(IMAGES)):
            given.append(frame.index)
            yield frame

    running = Odometry(CAMERA, OPTIONS).run(watched())
    next(running)
    assert given == [0]
    next(running)
    assert given == [0, 1]


def test_a_frozen_frame_is_static():
    still = run([IMAGES[0], IMAGES[1], IMAGES[1], IMAGES[2]])
    assert statuses(still) == ["-", "OK", "STATIC", "OK"]
    assert compared(still)[1:] == [(0, 1), (1, 2), (2, 3)]
    moved = still[2].world_from_cam[:3, 3] - still[1].world_from_cam[:3, 3]
    assert np.abs(moved).max() < 0.02
    assert still[2].scale is None


def test_a_camera_that_only_turns_stays_where_it_is():
    turning = run(drive(3, t=np.zeros(3)))
    assert statuses(turning) == ["-", "ROTATION_ONLY", "ROTATION_ONLY"]
    for result in turning:
        np.testing.assert_array_equal(result.world_from_cam[:3, 3], np.zeros(3))
    R = turning[2].world_from_cam[:3, :3]
    assert math.degrees(so3.angle_between(R.T, TURN @ TURN)) < 0.05


SMALL = np.ascontiguousarray(IMAGES[2][::2, ::2])


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (BLACK, "nothing to track"),
        (np.full_like(BLACK, 200), "nothing to track"),
        (None, "cannot be decoded: its data are damaged"),
        (SMALL, "160x120"),
    ],
    ids=["black", "grey", "undecodable", "size"],
)
def test_a_bad_frame_is_passed_over(bad, words):
    around = run([IMAGES[0], IMAGES[1], bad, IMAGES[2]])
    assert statuses(around) == ["-", "OK", "FAILED", "OK"]
    assert compared(around)[1:] == [(0, 1), (1, 2), (1, 3)]
    assert words in around[2].pose.reason
    assert around[2].pose.reason.endswith(".")
    assert around[3].timestamp0 == around[1].timestamp
    np.testing.assert_array_equal(around[2].world_from_cam, around[1].world_from_cam)
    assert len(around[2].tracks) == len(around[2].pose.labels) == 0
    # What comes after is what would have come without it.
    plain = run([IMAGES[0], IMAGES[1], IMAGES[2]])
    np.testing.assert_allclose(around[3].world_from_cam, plain[2].world_from_cam, atol=2e-3)
    np.testing.assert_array_equal(around[3].tracks.ids, plain[2].tracks.ids)


@pytest.mark.parametrize("bad", [BLACK, None], ids=["black", "undecodable"])
def test_a_sequence_may_begin_with_bad_frames(bad):
    late = run([bad, bad, IMAGES[0], IMAGES[1]])
    assert statuses(late) == ["FAILED", "FAILED", "-", "OK"]
    assert compared(late) == [(0, 0), (1, 1), (2, 2), (2, 3)]


def test_a_cut_begins_anew():
    cut = run([IMAGES[0], IMAGES[1], *drive(2, seed=77)])
    assert statuses(cut) == ["-", "OK", "FAILED", "OK"]
    assert compared(cut)[1:] == [(0, 1), (1, 2), (2, 3)]
    np.testing.assert_array_equal(cut[2].world_from_cam, cut[1].world_from_cam)
    assert [result.segment for result in cut] == [0, 0, 1, 1]
    # No track lives on, and no number is given twice.
    assert not np.isin(cut[3].tracks.ids, cut[1].tracks.ids).any()
    off = so3.angle_between(cut[3].pose.rotation_cam1_from_cam0, TURN)
    assert math.degrees(off) < 0.05


def test_a_calibration_for_another_size_is_refused():
    with pytest.raises(InputError, match=r"camera: images are 320x240 but .* 640x480"):
        run(list(IMAGES), Camera.pinhole(640, 480, 300.0, 300.0, 319.5, 239.5))


def test_the_first_frame_gives_the_size_that_the_calibration_does_not():
    odometry = Odometry(Camera(model=CAMERA.model), OPTIONS)
    list(odometry.run(frames([None, IMAGES[0], IMAGES[1]])))
    assert odometry.camera.size == (WIDTH, HEIGHT)


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((HEIGHT, WIDTH, 3), np.uint8),
        np.zeros((HEIGHT, WIDTH)),
        np.zeros((HEIGHT, WIDTH), np.uint16),
        np.zeros(WIDTH, np.uint8),
        "image.png",
    ],
    ids=["colour", "float", "16 bit", "row", "path"],
)
@pytest.mark.parametrize("before", [0, 1], ids=["first", "second"])
def test_an_image_that_is_not_grey_bytes_is_refused(image, before):
    odometry = Odometry(CAMERA, OPTIONS)
    for k in range(before):
        odometry.process(IMAGES[k], float(k))
    with pytest.raises(InputError, match="image"):
        odometry.process(image, 1.0)


def test_options_reach_the_stage_they_are_for():
    options = OdometryOptions(
        tracker=TrackerOptions(max_tracks=60), pose=RelativePoseOptions(refine=False), seed=4
    )
    results = list(Odometry(CAMERA, options).run(frames(IMAGES[:2])))
    assert len(results[1].tracks) <= 60
    assert results[1].pose.stats.cost is None  # the closed form has no likelihood


def test_black_repeated_and_dropped_frames_keep_the_scale():
    # Frames 2 and 4 are black and repeated, the fourth picture was dropped: steps of 1, 1, 0 and 2.
    results = run([IMAGES[0], IMAGES[1], BLACK, IMAGES[2], IMAGES[2], IMAGES[4], IMAGES[5]])
    assert statuses(results) == ["-", "OK", "FAILED", "OK", "STATIC", "OK", "OK"]
    assert {result.segment for result in results} == {0}
    lengths = [result.scale for result in results[1:]]
    assert lengths[1] is None
    assert lengths[3] is None
    assert [lengths[0], lengths[2], lengths[4], lengths[5]] == pytest.approx([1, 1, 2, 1], rel=0.03)
    way = np.linalg.norm(results[-1].world_from_cam[:3, 3])
    assert way == pytest.approx(5.0, rel=0.03)


def test_a_cut_begins_a_segment_and_its_scale_begins_anew():
    other = drive(4, seed=6)
    results = run([*IMAGES[:3], *other])
    assert [result.segment for result in results] == [0, 0, 0, 1, 1, 1, 1]
    np.testing.assert_array_equal(results[3].world_from_cam, results[2].world_from_cam)
    np.testing.assert_array_equal(results[3].world_covariance, np.zeros((7, 7)))
    assert results[4].scale_sigma == 0.0
    assert results[5].scale_sigma > 0.0


@pytest.mark.parametrize("interval_s", [1e-9, 1e12])
def test_times_shorter_or_longer_than_any_shutter(interval_s: float):
    odometry = Odometry(CAMERA, OPTIONS)
    results = [odometry.process(image, k * interval_s) for k, image in enumerate(IMAGES)]
    assert statuses(results)[1:] == ["OK"] * (len(IMAGES) - 1)
