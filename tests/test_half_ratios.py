"""What halves of the tracks have shown of a video, and what its next pair makes of it."""

from __future__ import annotations

import numpy as np
import pytest

from boards import CAMERA, drive
from farpoint import Odometry, OdometryOptions, RelativePoseOptions
from farpoint.odometry import sequence
from farpoint.odometry.half_ratios import HalfRatios
from farpoint.tracks import TrackerOptions


def test_the_mean_begins_with_what_was_expected_and_goes_to_what_is_shown():
    ratios = HalfRatios(1.0)
    ratios.add(None)
    assert ratios.mean == 1.0
    ratios.add(2.5)
    assert ratios.mean == pytest.approx((2 * 1.0 + 2.5) / 3)
    shown = np.random.default_rng(3).gamma(8.0, 0.7 / 8.0, 90)
    for ratio in shown:
        ratios.add(ratio)
    assert ratios.mean == pytest.approx((2 * 1.0 + 2.5 + shown.sum()) / (2 + 1 + 90))


def test_two_motions_of_one_pair_do_not_tell_of_the_others():
    ratios = HalfRatios(1.0)
    ratios.add(50.0)
    assert ratios.mean == pytest.approx((2 * 1.0 + 3.0) / 3)


def test_what_is_long_past_is_forgotten():
    ratios = HalfRatios(1.0)
    for ratio in [2.0] * 1000 + [0.5] * 300:
        ratios.add(ratio)
    assert ratios.mean == pytest.approx(0.5 + 1.5 * 0.99**300)


def odometry(**options) -> Odometry:
    pose = RelativePoseOptions(**options)
    tracker = TrackerOptions(max_tracks=250)
    return Odometry(CAMERA.with_readout(0.0), OdometryOptions(tracker=tracker, pose=pose))


def test_a_pair_uses_the_mean_ratio_of_the_earlier_pairs():
    images = drive(4)
    learning, computed = odometry(half_splits=8), odometry()
    expected = 2.0
    for k, image in enumerate(images):
        ours, plain = (each.process(image, 0.1 * k).pose for each in (learning, computed))
        if ours is None:
            continue
        shown = ours.stats.half_ratio
        np.testing.assert_allclose(
            ours.covariance,
            (40.0 * expected / (k + 1) + 40.0 * shown) / 80.0 * plain.covariance,
            rtol=1e-9,
        )
        expected += shown


def test_halves_of_a_pair_use_the_mean_ratio_too():
    images = drive(5)
    plain, doubting = odometry(), odometry(half_splits=8, expected_half_ratio=50.0)
    computed, doubted = (
        each.split_half([each.process(image, 0.1 * k) for k, image in enumerate(images)][-1])
        for each in (plain, doubting)
    )
    # After four pairs, which show about one, (2 * 50 + 4) / 6 is expected, and no longer 50.
    ratio = np.trace(doubted.covariance) / np.trace(computed.covariance)
    assert 0.5 * 17.0 < ratio < 0.5 * 25.0


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


def test_a_ratio_that_is_none_is_refused():
    with pytest.raises(ValueError, match="expected_half_ratio"):
        RelativePoseOptions(expected_half_ratio=0.0)
