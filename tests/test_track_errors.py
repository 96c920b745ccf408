"""What earlier pairs of a video show of the errors of its tracks, and what the next makes of it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from boards import CAMERA, drive
from farpoint import Odometry, OdometryOptions, RelativePoseOptions
from farpoint.odometry import sequence
from farpoint.pose import track_errors
from farpoint.pose.track_errors import TrackErrors
from farpoint.tracks import TrackerOptions


def test_the_means_begin_with_what_was_expected_and_go_to_what_is_shown():
    errors = TrackErrors()
    assert errors.with_pair(None, 0.3) == errors.with_pair(2.0, None) == errors
    errors = errors.with_pair(2.5, 0.35)
    assert errors.half_ratio == pytest.approx((1.0 + 2.5) / 2)
    assert errors.correlation == pytest.approx((0.17 + 0.35) / 2)
    rng = np.random.default_rng(3)
    ratios, correlations = rng.gamma(8.0, 0.7 / 8.0, 90), rng.normal(0.3, 0.05, 90)
    for pair in zip(ratios, correlations, strict=True):
        errors = errors.with_pair(*pair)
    assert errors.half_ratio == pytest.approx((1.0 + 2.5 + ratios.sum()) / 92)
    assert errors.correlation == pytest.approx((0.17 + 0.35 + correlations.sum()) / 92)


def test_two_motions_of_one_pair_do_not_tell_of_the_others():
    assert TrackErrors().with_pair(50.0, 0.0).half_ratio == pytest.approx((1.0 + 3.0) / 2)


def test_what_is_long_past_is_forgotten():
    errors = TrackErrors()
    for ratio in [2.0] * 1000 + [0.5] * 300:
        errors = errors.with_pair(ratio, 0.1 * ratio)
    assert errors.half_ratio == pytest.approx(0.5 + 1.5 * 0.99**300)
    assert errors.correlation == pytest.approx(0.05 + 0.15 * 0.99**300)


def test_this_pair_and_the_earlier_ones_weigh_by_their_degrees_of_freedom():
    errors = TrackErrors(half_ratio=2.0)
    assert errors.inflation_by_halves(None, 40) == 2.0
    assert errors.inflation_by_halves(1.0, 40) == pytest.approx(1.5)
    assert errors.inflation_by_halves(1.0, 24) == pytest.approx((80.0 + 24.0) / 64.0)


@pytest.mark.parametrize(
    ("correlation", "log_growth"), [(-0.1, 0.0), (0.17, 0.0), (0.3, 1.3), (0.46, 2.9), (0.8, 2.9)]
)
def test_errors_common_to_halves_grow_with_the_correlation(correlation: float, log_growth: float):
    errors = TrackErrors(correlation=correlation)
    assert errors.common_to_halves(10.0) == pytest.approx(math.expm1(log_growth))
    assert errors.common_to_halves(0.0) == 0.0
    expected = errors.half_ratio + math.expm1(log_growth)
    assert errors.expected_inflation(10.0) == pytest.approx(expected)


def odometry(**options) -> Odometry:
    pose = RelativePoseOptions(**options)
    tracker = TrackerOptions(max_tracks=250)
    return Odometry(CAMERA.with_readout(0.0), OdometryOptions(tracker=tracker, pose=pose))


def test_a_pair_uses_the_mean_ratio_of_the_earlier_pairs():
    images = drive(4)
    learning, computed = odometry(half_splits=8), odometry()
    expected = 1.0
    for k, image in enumerate(images):
        ours, plain = (each.process(image, 0.1 * k).pose for each in (learning, computed))
        if ours is None:
            continue
        shown = ours.stats.half_ratio
        np.testing.assert_allclose(
            ours.covariance,
            (40.0 * expected / k + 40.0 * shown) / 80.0 * plain.covariance,
            rtol=1e-9,
        )
        expected += shown


def test_errors_common_to_halves_are_added_to_their_ratio(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(track_errors, "UNCOMPRESSED_CORRELATION", -0.5)  # less than any shows
    images = drive(4)
    plain, doubting = odometry(half_splits=8), odometry(half_splits=8, common_error_slope=2.0)
    errors, grown = TrackErrors(), []
    for k, image in enumerate(images):
        without, with_common = (each.process(image, 0.1 * k).pose for each in (plain, doubting))
        if without is None:
            continue
        stats = without.stats
        by_halves = errors.inflation_by_halves(stats.half_ratio, 40)
        errors = errors.with_pair(stats.half_ratio, stats.residual_correlation)
        growth = 1.0 + errors.common_to_halves(2.0) / by_halves
        np.testing.assert_allclose(with_common.covariance, growth * without.covariance, rtol=1e-9)
        grown.append(growth)
    assert min(grown) > 1.5


def test_every_pair_of_every_run_is_split_differently(monkeypatch: pytest.MonkeyPatch):
    dealt: list[int] = []
    monkeypatch.setattr(sequence, "split_half", lambda *_, seed, **__: dealt.append(seed))
    images = drive(3)
    for seed in range(3):
        run = Odometry(CAMERA, OdometryOptions(seed=seed))
        for k, image in enumerate(images):
            result = run.process(image, 0.1 * k)
            if result.pose is not None:
                run.split_half(result)
    assert len(set(dealt)) == len(dealt) == 3 * (len(images) - 1)
