"""The life of tracks: begun, followed, lost, replaced; and what may come in between."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from tracks_textures import Waves, photo

import farpoint.tracks.tracker as tracker_module
from farpoint.errors import InputError
from farpoint.tracks import (
    CornerOptions,
    LucasKanadeOptions,
    RefinementOptions,
    Tracker,
    TrackerOptions,
    Tracks,
)
from farpoint.tracks.lucas_kanade import track_points

SCENE = Waves(11, shape=(240, 320))
STILL = photo(SCENE.grey())
BLACK = np.zeros_like(STILL)
FEW = TrackerOptions(max_tracks=120)


def started(image: np.ndarray = STILL, options: TrackerOptions = FEW) -> Tracker:
    tracker = Tracker(options)
    tracker.restart(image)
    return tracker


@pytest.mark.parametrize("shift", [(0.0, 0.0), (3.25, -7.6), (-24.4, 15.1)])
def test_tracks_follow_a_known_shift(shift):
    tracks = started().match(photo(SCENE.grey(shift=shift)))
    error = tracks.points1 - SCENE.moved(tracks.points0, shift=shift)
    assert len(tracks) > 80
    assert np.quantile(np.abs(error), 0.98) < 0.05


def test_tracks_live_on_with_their_ids_through_a_sequence():
    tracker = Tracker(FEW)
    shifts = [(2.3 * k, -1.4 * k) for k in range(8)]
    seen: dict[int, np.ndarray] = {}
    begun: dict[int, np.ndarray] = {}
    for k, shift in enumerate(shifts):
        tracks = tracker.track(photo(SCENE.grey(shift=shift)))
        for identity, point0, point1 in zip(
            tracks.ids, tracks.points0, tracks.points1, strict=True
        ):
            if k > 1 and identity in seen:
                np.testing.assert_array_equal(seen[identity], point0)
            seen[identity] = point1
            begun.setdefault(identity, point0)
    assert tracks.ids.dtype == np.int64
    assert len(np.unique(tracks.ids)) == len(tracks)
    old = tracks.ids < 120  # begun in the first image
    assert old.sum() > 60
    # Seven matches, each to a few hundredths of a pixel, have not drifted off the scene.
    start = np.array([begun[identity] for identity in tracks.ids[old]])
    assert np.median(np.abs(tracks.points1[old] - start - shifts[-1])) < 0.05


def test_tracks_begin_at_all_fractions_of_a_pixel():
    """On whole pixels they would share what interpolation does to a match, and be off together."""
    fraction = (started(options=TrackerOptions(max_tracks=400)).points % 1.0).T
    for values in fraction:
        held, _ = np.histogram(values, bins=8, range=(0, 1))
        assert held.min() > 0.6 * held.mean()
    assert abs(np.corrcoef(fraction)[0, 1]) < 0.15


def test_missing_tracks_are_replenished_and_ids_never_used_again():
    tracker = started()
    first = tracker.ids
    assert len(first) == FEW.max_tracks
    tracks = tracker.match(STILL)
    tracker.advance(STILL, tracks.select(tracks.points1[:, 0] < 160))
    assert len(tracker.ids) == FEW.max_tracks
    gone = np.setdiff1d(first, tracker.ids)
    new = np.setdiff1d(tracker.ids, first)
    assert len(gone) == len(new) > 40
    assert new.min() > first.max()
    assert np.mean(tracker.points[np.isin(tracker.ids, new), 0] > 155) > 0.95
    tracker.restart(STILL)
    assert tracker.ids.min() > new.max()


def test_matching_changes_nothing_so_that_a_frame_can_be_passed_over():
    moved = photo(SCENE.grey(shift=(4, 2)))
    direct = started().match(moved)
    tracker = started()
    assert len(tracker.match(BLACK)) == 0
    again = tracker.match(moved)
    for name in ("ids", "points0", "points1", "covariance_px2"):
        np.testing.assert_array_equal(getattr(again, name), getattr(direct, name))


def test_advancing_to_black_and_back_begins_anew():
    tracker = started()
    assert len(tracker.track(BLACK)) == 0
    assert len(tracker.track(STILL)) == 0
    assert len(tracker.track(STILL)) > 100


@pytest.mark.parametrize("image", [BLACK, np.full_like(STILL, 255), np.zeros((1, 1), np.uint8)])
def test_featureless_and_tiny_images_have_no_tracks(image):
    tracker = Tracker()
    assert len(tracker.track(image)) == 0
    assert len(tracker.track(image)) == 0


def test_noise_on_the_images_is_tracked_through_with_a_larger_covariance():
    shift = (2.6, 1.7)
    sigma = []
    for noise in (0.0, 3.0):
        rng = np.random.default_rng(3)
        tracker = started(photo(SCENE.grey(), noise, rng))
        tracks = tracker.match(photo(SCENE.grey(shift=shift), noise, rng))
        error = tracks.points1 - SCENE.moved(tracks.points0, shift=shift)
        assert len(tracks) > 80
        assert np.median(np.linalg.norm(error, axis=1)) < 0.08
        sigma.append(np.sqrt(np.median(np.trace(tracks.covariance_px2, axis1=1, axis2=2) / 2)))
    assert sigma[1] > 1.5 * sigma[0]


def test_unrelated_images_share_next_to_nothing():
    assert len(started().match(photo(Waves(12, shape=STILL.shape).grey()))) < 6


def test_prediction_finds_what_large_motion_hides():
    shift = (61.0, -38.0)
    moved = photo(SCENE.grey(shift=shift))
    options = TrackerOptions(max_tracks=120, matching=LucasKanadeOptions(levels=2))
    blind = started(options=options).match(moved)
    told = started(options=options).match(moved, lambda points: points + np.array([58.0, -40.0]))
    true = SCENE.moved(told.points0, shift=shift)
    assert len(told) > 50 > 5 * len(blind)
    assert np.quantile(np.abs(told.points1 - true), 0.95) < 0.05


def test_a_prediction_tells_how_windows_change_their_shapes():
    """As in a wide lens, where what moves outwards is squeezed."""
    motion = {"shift": (2.0, -1.0), "scale": 0.65}
    moved = photo(SCENE.grey(**motion))
    told = started().match(moved, lambda points: SCENE.moved(points, **motion))
    untold = started().match(moved)
    told_px, untold_px = (
        np.median(np.linalg.norm(tracks.points1 - SCENE.moved(tracks.points0, **motion), axis=1))
        for tracks in (told, untold)
    )
    assert len(told) > 1.8 * len(untold)
    assert told_px < 0.02
    assert untold_px > 1.5 * told_px


def test_a_wrong_prediction_costs_no_tracks():
    moved = photo(SCENE.grey(shift=(3, 2)))
    tracks = started().match(moved)
    for wrong in (
        lambda p: p + np.array([150.0, 90.0]),
        lambda p: np.full_like(p, np.nan),
        lambda p: p * 1e9,
    ):
        assert len(started().match(moved, wrong)) == len(tracks)


def test_a_prediction_that_is_right_for_a_third_of_the_tracks_is_not_kept():
    moved = photo(SCENE.grey(shift=(3, 2)))

    def partly_wrong(points: np.ndarray) -> np.ndarray:
        expected = points + np.array([3.0, 2.0])
        wrong = points[:, 0] > 70.0  # of 320 px
        expected[wrong, 1] = SCENE.grey().shape[0] - 1.0 - expected[wrong, 1]
        return expected

    assert len(started().match(moved, partly_wrong)) == len(started().match(moved))


@pytest.mark.parametrize("is_right", [True, False])
def test_tracks_that_leave_the_image_as_predicted_are_not_matched_again(
    is_right: bool, monkeypatch: pytest.MonkeyPatch
):
    """Of 320 px, 180 leave the image; a wrong prediction that only 18 leave it is tried, too."""
    starts = []

    def counted(image0, image1, points0, start, options):
        starts.append(start)
        return track_points(image0, image1, points0, start, options)

    monkeypatch.setattr(tracker_module, "track_points", counted)
    moved, shift = photo(SCENE.grey(shift=(-180.0, 4.0))), (-180.0, 4.0) if is_right else (-18.0, 9)
    tracks = started().match(moved, lambda points: points + np.array(shift))
    assert len(tracks) > 20 or not is_right
    assert (len(starts) == 1) == is_right


def test_tracks_that_leave_the_image_are_dropped():
    tracker = started()
    tracks = tracker.match(photo(SCENE.grey(shift=(-20, 0))))
    reach = RefinementOptions().window_px // 2
    left = tracker.points[:, 0] < 20 + reach
    assert left.sum() > 3
    assert not np.isin(tracker.ids[left], tracks.ids).any()
    assert tracks.points1[:, 0].min() >= reach


def test_tracks_that_run_together_become_one():
    tracker = started()
    tracks = tracker.match(STILL)
    points1 = tracks.points1.copy()
    points1[5] = points1[2] + (1.0, 0.5)
    merged = Tracks(
        ids=tracks.ids,
        points0=tracks.points0,
        points1=points1,
        covariance_px2=tracks.covariance_px2,
    )
    tracker.advance(STILL, merged)
    assert tracks.ids[2] in tracker.ids
    assert tracks.ids[5] not in tracker.ids


def test_no_track_begins_under_the_mask():
    mask = np.ones(STILL.shape, bool)
    mask[120:] = False
    tracker = Tracker(FEW, mask=mask)
    tracker.restart(STILL)
    assert len(tracker.points) > 40
    assert tracker.points[:, 1].max() < 120


def test_the_number_of_threads_does_not_change_a_bit():
    def run() -> list[bytes]:
        tracker = Tracker(FEW)
        shifts = [(1.7 * k, 0.9 * k) for k in range(4)]
        results = [tracker.track(photo(SCENE.grey(shift=shift))) for shift in shifts]
        return [r.points1.tobytes() + r.covariance_px2.tobytes() + r.ids.tobytes() for r in results]

    threads = cv2.getNumThreads()
    try:
        cv2.setNumThreads(1)
        one = run()
        cv2.setNumThreads(4)
        four = run()
    finally:
        cv2.setNumThreads(threads)
    assert one == four
    assert len(one[-1]) > 0


def test_the_caller_may_reuse_his_image_buffer():
    buffer = STILL.copy()
    tracker = started(buffer)
    buffer[:] = 0
    assert len(tracker.match(STILL)) > 100


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((40, 40)),
        np.zeros((40, 40, 3), np.uint8),
        np.zeros((40, 40), np.uint16),
        np.zeros((0, 40), np.uint8),
        [[0, 1], [2, 3]],
        None,
    ],
)
def test_what_is_no_grey_image_is_refused(image):
    with pytest.raises(InputError, match=r"^image: expected"):
        Tracker().track(image)


def test_another_size_is_refused_until_restarted():
    tracker = started()
    with pytest.raises(InputError, match=r"^image: expected 320x240 pixels .* got 100x80"):
        tracker.match(np.zeros((80, 100), np.uint8))
    tracker.restart(STILL[:80, :100])
    assert len(tracker.match(STILL[:80, :100])) > 5


def test_wrong_predictions_and_masks_are_refused():
    with pytest.raises(InputError, match=r"^predict: expected it to return shape"):
        started().match(STILL, lambda points: points[:3])
    with pytest.raises(InputError, match=r"^mask: expected bool"):
        Tracker(mask=np.ones((4, 4)))
    with pytest.raises(InputError, match=r"^mask: expected 320x240"):
        Tracker(mask=np.ones((4, 4), bool)).restart(STILL)


@pytest.mark.parametrize(
    ("kind", "field", "value"),
    [
        (TrackerOptions, "max_tracks", 0),
        (TrackerOptions, "max_tracks", 10.5),
        (CornerOptions, "cell_px", 0),
        (CornerOptions, "min_slope", float("nan")),
        (LucasKanadeOptions, "window_px", 10),
        (LucasKanadeOptions, "levels", -1),
        (LucasKanadeOptions, "forward_backward_px", 0.0),
        (RefinementOptions, "window_px", 7),
        (RefinementOptions, "affine_sigma", float("inf")),
        (RefinementOptions, "min_correlation", 1.5),
    ],
)
def test_options_out_of_range_are_refused_by_name(kind, field, value):
    with pytest.raises(InputError, match=f"^{field}: expected"):
        kind(**{field: value})
