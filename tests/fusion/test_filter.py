"""The filter is as sure as it is right, beats what it is made of, and shows a false covariance."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from fusion_kit import (
    BODY_FROM_CAM,
    NOISE,
    START,
    failed,
    fly,
    fused,
    new_filter,
    seen_pose,
    turned_only,
    winding_path,
)

from farpoint.errors import InputError
from farpoint.fusion import InertialFilter, InertialState, StartSigmas
from farpoint.fusion.state import (
    ATTITUDE,
    DISPLACEMENT,
    GYRO_BIAS,
    KNOWN,
    LAST_ATTITUDE,
    difference,
)
from farpoint.geometry import so3, sphere
from farpoint.metrics import chi2_quantile

RUNS = 20


@dataclass(frozen=True, kw_only=True, eq=False)
class Flights:
    """Figures of many flights, (runs, images) each."""

    nees: np.ndarray
    nis: np.ndarray
    attitude_rad: np.ndarray
    direction_rad: np.ndarray
    speed_error: np.ndarray
    direction_nees: np.ndarray


def direction_nees(filter_: InertialFilter, truth: InertialState) -> float:
    direction, covariance = filter_.travel_direction()
    np.testing.assert_allclose(covariance @ direction, 0.0, atol=1e-6 * np.trace(covariance))
    basis = sphere.tangent_basis(direction)
    off = basis.T @ sphere.normalize(truth.velocity_body)
    return float(off @ np.linalg.solve(basis.T @ covariance @ basis, off))


@cache
def flights(claim: float = 1.0, blind: bool = False, runs: int = RUNS) -> Flights:
    rows = []
    for seed in range(runs):
        flight = fly(winding_path(), seed, begin_s=0.5 * seed)
        for filter_, innovation, truth in fused(flight, seed, claim=claim, blind=blind):
            velocity, true = filter_.state.velocity_body, truth.velocity_body
            rows.append(
                (
                    filter_.nees(truth),
                    innovation.nis,
                    so3.angle_between(filter_.state.world_from_body, truth.world_from_body),
                    sphere.angle_between(sphere.normalize(velocity), sphere.normalize(true)),
                    np.linalg.norm(velocity) - np.linalg.norm(true),
                    direction_nees(filter_, truth),
                )
            )
    columns = np.array(rows).reshape(runs, -1, 6)
    return Flights(**dict(zip(Flights.__annotations__, np.moveaxis(columns, 2, 0), strict=True)))


def by_chance(dof: int) -> tuple[float, float]:
    """Where the mean of RUNS honest squares lies in 999 of 1000 cases."""
    total = RUNS * dof
    return chi2_quantile(0.0005, total) / RUNS, chi2_quantile(0.9995, total) / RUNS


def test_the_filter_is_as_sure_as_it_is_right():
    low, high = by_chance(12)
    assert low < flights().nees[:, 0].mean() < high
    assert low < flights().nees[:, -1].mean() < high
    # Between them the speed is found, which is not quite linear: a fifth too sure is the bound.
    assert 0.8 < flights().nees.mean() / 12.0 < 1.44


def test_innovations_are_as_large_as_expected():
    nis = flights().nis[:, 5:]  # the first ones see the unknown speed
    assert nis.mean() == pytest.approx(5.0, abs=4.0 * np.sqrt(10.0 / nis.size))


def test_a_covariance_ten_times_too_small_makes_it_sure_of_what_is_wrong():
    lied_to = flights(claim=0.1, runs=8)
    _, high = by_chance(12)
    assert lied_to.nees[:, -1].mean() > 2.0 * high
    assert lied_to.nis[:, 5:].mean() > 20.0
    assert rms(lied_to.attitude_rad[:, -1]) > rms(flights().attitude_rad[:8, -1])


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_fusion_beats_the_imu_alone():
    both, imu = flights(), flights(blind=True)
    for name in ("attitude_rad", "direction_rad", "speed_error"):
        assert rms(getattr(both, name)[:, -1]) < 0.2 * rms(getattr(imu, name)[:, -1]), name
    low, high = by_chance(12)
    assert low < imu.nees[:, 3].mean() < high


def test_fusion_beats_the_camera_alone():
    """A camera has the first attitude and its rotations, and a new direction for every pair."""
    attitudes, directions = [], []
    for seed in range(RUNS):
        flight = fly(winding_path(), seed, begin_s=0.5 * seed)
        rng = np.random.default_rng([seed, 2])
        world_from_body = new_filter(flight, seed).state.world_from_body
        for R_true, t_true in flight.motions:
            pose = seen_pose(R_true, t_true, rng)
            directions.append(
                sphere.angle_between(pose.direction_cam1_from_cam0, sphere.normalize(t_true))
            )
            R = BODY_FROM_CAM[:3, :3] @ pose.rotation_cam1_from_cam0 @ BODY_FROM_CAM[:3, :3].T
            world_from_body = world_from_body @ R.T
        attitudes.append(so3.angle_between(world_from_body, flight.states[-1].world_from_body))
    assert rms(flights().attitude_rad[:, -1]) < 0.5 * rms(np.array(attitudes))
    assert rms(flights().direction_rad[:, 20:]) < 0.8 * rms(np.array(directions))


def test_the_speed_is_learnt_though_no_direction_tells_it():
    assert rms(flights().speed_error[:, -1]) < 0.6 * START.velocity


def test_the_direction_of_travel_has_a_covariance_of_its_own():
    low, high = by_chance(2)
    assert low < flights().direction_nees[:, -1].mean() < high


def test_the_first_covariance_is_that_of_the_sigmas():
    start = StartSigmas(tilt_rad=1.0, heading_rad=2.0, velocity=3.0, gyro_bias=4.0, accel_bias=5.0)
    covariance = start.covariance()
    expected = np.square([1, 1, 2, 3, 3, 3, 4, 4, 4, 5, 5, 5, 0, 0, 0, 1, 1, 2])
    np.testing.assert_array_equal(np.diag(covariance), expected)
    np.testing.assert_array_equal(covariance[LAST_ATTITUDE, ATTITUDE], np.diag(expected[:3]))


def test_after_an_image_the_next_motion_starts_from_it():
    *_, (filter_, _, _) = fused(fly(winding_path(), seed=1, seconds=0.5), seed=1)
    np.testing.assert_array_equal(filter_.state.displacement, 0.0)
    np.testing.assert_array_equal(filter_.state.last_world_from_body, filter_.state.world_from_body)
    C = filter_.covariance
    np.testing.assert_array_equal(C[DISPLACEMENT], 0.0)
    np.testing.assert_array_equal(C[LAST_ATTITUDE, LAST_ATTITUDE], C[ATTITUDE, ATTITUDE])
    assert np.linalg.eigvalsh(C[KNOWN, KNOWN])[0] > 0.0


def test_rotation_alone_teaches_the_gyro_bias_and_no_speed():
    flight, rng = fly(winding_path(), seed=2), np.random.default_rng(3)
    filter_ = new_filter(flight, seed=2)
    for steps, motion in zip(flight.steps, flight.motions, strict=True):
        filter_.predict(steps)
        innovation = filter_.update(turned_only(seen_pose(*motion, rng)))
        assert (innovation.dof, innovation.used) == (3, True)
    sigma = np.sqrt(np.diag(filter_.covariance))
    assert (sigma[GYRO_BIAS] < 0.1 * START.gyro_bias).all()
    error = difference(flight.states[-1], filter_.state)
    assert (np.abs(error[GYRO_BIAS]) < 4.0 * sigma[GYRO_BIAS]).all()
    speed_sigma = np.sqrt(np.trace(filter_.covariance[3:6, 3:6]))
    assert speed_sigma > START.velocity


def test_a_failed_pair_teaches_nothing():
    flight = fly(winding_path(), seed=2)
    filter_ = new_filter(flight, seed=2)
    filter_.predict(flight.steps[0])
    before = filter_.state
    rng = np.random.default_rng(0)
    innovation = filter_.update(failed(seen_pose(*flight.motions[0], rng)))
    assert (innovation.dof, innovation.used) == (0, False)
    np.testing.assert_array_equal(filter_.state.velocity, before.velocity)
    np.testing.assert_array_equal(filter_.state.displacement, 0.0)


def test_the_gate_ignores_what_cannot_be():
    flight, rng = fly(winding_path(), seed=4), np.random.default_rng(4)
    filter_ = new_filter(flight, seed=4, gate=0.9999)
    for k, (steps, motion) in enumerate(zip(flight.steps, flight.motions, strict=True)):
        filter_.predict(steps)
        R, t = motion
        junk = k == 20
        innovation = filter_.update(seen_pose(so3.exp([0.0, 0.1, 0.0]) @ R if junk else R, t, rng))
        assert innovation.used != junk
    assert filter_.nees(flight.states[-1]) < chi2_quantile(0.9999, 12)


def test_steps_can_be_given_one_by_one_or_many_at_once():
    flight = fly(winding_path(), seed=5)
    whole, single = new_filter(flight, seed=5), new_filter(flight, seed=5)
    whole.predict(flight.steps[0])
    for step in flight.steps[0].parts(1):
        single.predict(step)
    np.testing.assert_allclose(difference(whole.state, single.state), 0.0, atol=1e-12)
    np.testing.assert_allclose(whole.covariance, single.covariance, rtol=1e-4, atol=1e-12)


def test_arguments_that_mean_nothing_are_refused():
    state = InertialState.at(np.eye(3), np.zeros(3))
    with pytest.raises(InputError, match=r"^body_from_cam: expected a 4x4"):
        InertialFilter(state, StartSigmas(), NOISE, np.eye(3))
    with pytest.raises(InputError, match=r"^gate: expected a probability"):
        InertialFilter(state, StartSigmas(), NOISE, np.eye(4), gate=99.0)
