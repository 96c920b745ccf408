"""Hints bring metres; wrong ones are named, and bend nothing."""

from __future__ import annotations

import numpy as np
import pytest
from aiding_kit import CAMERA, UNIT_M, Drive, errors_of, tell, winding

from farpoint.aiding import (
    CameraHeight,
    GnssPositions,
    KnownDistance,
    KnownSpeed,
    MetricScale,
    Reading,
    fit_readings,
)


def speeds_of(drive: Drive, factor: float | np.ndarray = 1.0, seed: int | None = None):
    speeds = drive.speeds * factor
    if seed is not None:
        speeds = speeds * (1.0 + 0.02 * np.random.default_rng(seed).normal(size=len(speeds)))
    return KnownSpeed(timestamps_s=drive.middles_s, speeds=speeds, sigma=0.02)


def wrong_for_a_tenth(drive: Drive, begin: int) -> np.ndarray:
    factor = np.ones(len(drive.speeds))
    factor[begin : begin + len(factor) // 10] = 1.3
    return factor


@pytest.mark.parametrize("seed", range(5))
def test_a_speed_brings_metres(seed):
    drive = winding()
    scale, now = tell(drive, speeds_of(drive, seed=seed))
    assert np.abs(errors_of(drive, scale)).max() < 0.02
    assert scale.fit().contradictions == ()
    assert now.metres_per_unit == pytest.approx(np.exp(drive.log_unit[-1]), rel=0.02)
    assert 0.02 <= now.sigma < 0.03  # all speeds may be wrong together


@pytest.mark.parametrize("begin", [0, 150, 359])
def test_a_speed_wrong_for_ten_percent_of_a_drive_is_reported_and_changes_no_length(begin):
    drive = winding()
    scale, _ = tell(drive, speeds_of(drive, wrong_for_a_tenth(drive, begin), seed=1))
    assert np.abs(errors_of(drive, scale)).max() < 0.03
    (found,) = scale.fit().contradictions
    assert found.kind == "speed"
    assert found.ratio == pytest.approx(1.3, abs=0.06)
    first, last = drive.times_s[begin], drive.times_s[min(begin + 39, 399)]
    assert abs(found.start_s - first) < 1.1
    assert abs(found.end_s - last) < 1.1
    assert f"{found.ratio:.2f} times" in str(found)
    assert str(found).startswith("speed: from")


@pytest.mark.parametrize("factor", [1.3, 0.7])
def test_a_wrong_speed_at_the_end_of_a_long_drive_changes_no_length(factor):
    # There the scale may have drifted most, and nothing after the wrong speeds holds it.
    drive = winding(count=1000, drift=0.03)
    drive.drift_sigma = 0.07
    excluded = np.ones(len(drive.speeds))
    excluded[-100:] = factor
    plain, _ = tell(drive, speeds_of(drive, seed=1))
    scale, now = tell(drive, speeds_of(drive, excluded, seed=1))
    assert np.abs(errors_of(drive, scale)).max() < 0.03
    assert abs(scale.fit().log_metres - plain.fit().log_metres).max() < 0.02
    assert now.metres_per_unit == pytest.approx(np.exp(drive.log_unit[-1]), rel=0.03)
    (found,) = scale.fit().contradictions
    assert found.ratio == pytest.approx(factor, abs=0.06)


def test_the_scale_follows_a_drift_and_no_faster_than_it_may():
    drive = winding(drift=0.1)
    drive.drift_sigma = 0.1
    scale, _ = tell(drive, speeds_of(drive))
    assert np.abs(errors_of(drive, scale)).max() < 0.01
    drive.drift_sigma = 1e-4  # an odometry that claims not to drift
    scale, _ = tell(drive, speeds_of(drive))
    fit = scale.fit()
    assert np.ptp(fit.log_metres) < 0.01


def test_the_sigma_is_honest():
    deviations = []
    for seed in range(200):
        rng = np.random.default_rng((seed, 9))
        drive = winding(count=100, drift=0.0)
        common = np.exp(0.02 * rng.normal())
        each = np.repeat(np.exp(0.02 * rng.normal(size=10)), 10)[: len(drive.speeds)]
        scale, _ = tell(drive, speeds_of(drive, common * each))
        fit = scale.fit()
        deviations.append((fit.log_metres[-1] - np.log(UNIT_M)) / fit.sigma[-1])
    assert 0.9 < np.mean(np.abs(deviations) < 1.96) < 0.985


def test_a_distance_brings_metres_where_it_is_known():
    drive = winding(drift=0.0)
    way = float(np.linalg.norm(drive.metres[120] - drive.metres[60]))
    scale, now = tell(drive, KnownDistance(frame0=60, frame1=120, distance_m=way, sigma=0.01))
    assert np.abs(errors_of(drive, scale)).max() < 1e-9
    assert len(scale.readings) == 1
    assert now.sigma == pytest.approx(np.sqrt(0.5) * 0.01, rel=0.5)


def test_positions_bring_metres():
    drive = winding()
    noise = np.random.default_rng(3).normal(0.0, 0.5, drive.metres.shape)
    measurement = GnssPositions(
        timestamps_s=drive.times_s[::5] + 0.03, positions_m=(drive.metres + noise)[::5], sigma_m=0.5
    )
    scale, _ = tell(drive, measurement)
    assert len(scale.readings) > 20
    fit = scale.fit()
    assert np.abs(errors_of(drive, scale)).max() < 2.5 * fit.sigma.max()
    assert fit.sigma.max() < 0.04


def test_contradicting_measurements_are_reported():
    drive = winding(drift=0.0)
    way = 1.4 * float(np.linalg.norm(drive.metres[120] - drive.metres[60]))
    excluded = KnownDistance(frame0=60, frame1=120, distance_m=way, sigma=0.02)
    scale, _ = tell(drive, speeds_of(drive), excluded)
    assert [found.kind for found in scale.fit().contradictions] == ["distance"]
    assert np.abs(errors_of(drive, scale)).max() < 0.02


def test_each_segment_has_its_own_scale():
    drive = winding(break_at=200)
    scale, _ = tell(drive, speeds_of(drive))
    assert np.abs(errors_of(drive, scale)).max() < 0.01
    # One without a hint goes on as the last one ended.
    few = KnownSpeed(timestamps_s=drive.middles_s[:150], speeds=drive.speeds[:150])
    scale, _ = tell(drive, few)
    fit = scale.fit()
    assert fit.at(44.0, 1)[0] == pytest.approx(np.exp(fit.log_metres[-1]))


def test_without_a_reading_there_is_no_scale():
    drive = winding()
    late = KnownSpeed(timestamps_s=drive.middles_s + 1000.0, speeds=drive.speeds)
    scale, now = tell(drive, late, CameraHeight(height_m=1.5))
    assert now is None
    assert scale.fit() is None
    slow = KnownSpeed(timestamps_s=drive.middles_s, speeds=0.01 * drive.speeds)
    assert tell(drive, slow)[1] is None


def test_variances_are_those_of_the_whole_matrix():
    rng = np.random.default_rng(0)
    count = 6
    readings = [
        Reading(
            kind=("a", "b")[k % 2],
            start_s=float(k),
            end_s=k + 1.0,
            segment=0,
            log_ratio=1e-9 * float(rng.normal()),  # deviations of zero: weights are (nu + 1) / nu
            sigma=0.01 * (1 + k),
            shared_sigma=(0.02, 0.05)[k % 2],
            drift=1e-4 * k,
        )
        for k in range(count)
    ]
    fit = fit_readings(readings)
    H = np.zeros((count + 2, count + 2))
    for k, reading in enumerate(readings):
        J = np.zeros(count + 2)
        J[k] = J[count + k % 2] = 1.0
        H += 4.0 / 3.0 / reading.sigma**2 * np.outer(J, J)
        H[count + k % 2, count + k % 2] += (k < 2) / reading.shared_sigma**2
        if k:
            step = np.zeros(count + 2)
            step[k], step[k - 1] = 1.0, -1.0
            H += np.outer(step, step) / 1e-4
    expected = np.sqrt(np.diag(np.linalg.inv(H))[:count])
    np.testing.assert_allclose(fit.sigma, expected, rtol=1e-6)


def test_cost_does_not_grow_with_the_drive():
    drive = winding()
    scale = MetricScale([speeds_of(drive)])
    for result in drive.results():
        scale.add(CAMERA, result)
    assert len(scale._recent) <= 120
