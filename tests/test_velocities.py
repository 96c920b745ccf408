"""Velocities that change from frame to frame, and what a rolling shutter makes of them."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from farpoint.bench.sequences import find_trajectories
from farpoint.camera import Camera
from farpoint.geometry import so3
from farpoint.metrics import chi2_quantile
from farpoint.metrics.association import poses_at_times
from farpoint.odometry import Odometry, sequence
from farpoint.odometry.constants import ANGULAR_ACCELERATION, DIRECTION_TURN_RATE
from farpoint.odometry.velocities import Velocities
from farpoint.path.velocities import velocity_between
from farpoint.pose import RelativePoseOptions, failed_pose
from farpoint.pose.certainty import direction_sigma
from farpoint.pose.shutter import VelocityPrior, shutter_of
from farpoint.pose.views import Views, estimate_views, search_views
from farpoint.synthetic import ImagingOptions, RenderedSequence, handheld_walk, render_drive

CAMERA = Camera.pinhole(640, 480, 500.0, 500.0, 319.5, 239.5)
INTERVAL_S, READOUT_S, NOISE_PX = 1.0 / 30.0, 0.025, 0.2


def means_of(coefficients: np.ndarray, begin: float) -> np.ndarray:
    """Mean of a polynomial (K, 3), lowest power first, over the unit of time from ``begin``."""
    powers = np.arange(1, len(coefficients) + 1)
    return ((begin + 1.0) ** powers - begin**powers) / powers @ coefficients


def test_rates_differ_by_the_change_of_a_velocity_of_second_degree():
    rng = np.random.default_rng(0)
    points = np.array([[10.0, 20.0], [600.0, 400.0]])
    for size in (2, 3):
        velocity = rng.normal(0.0, 0.01, (size, 3))
        prior = VelocityPrior(before=means_of(velocity, -1.0), sigma=0.01)
        shutter = shutter_of(CAMERA, points, points, READOUT_S, INTERVAL_S, prior)
        # Half of the second derivative is not continued from the rotation before.
        unknown = velocity[2] if size > 2 else np.zeros(3)
        shutter = shutter._replace(changes=np.concatenate([unknown, np.zeros(3)]))
        rate0, rate1 = (shutter.rate(means_of(velocity, 0.0), image) for image in (0, 1))
        np.testing.assert_allclose(rate1 - rate0, velocity[1:].sum(axis=0))
        if size == 2:
            np.testing.assert_allclose(rate0, velocity[0])


def test_a_rate_without_one_before_is_exact_with_the_first_derivative():
    velocity = np.array([[0.01, 0.02, -0.01], [0.003, -0.002, 0.001]])
    points = np.array([[10.0, 20.0]])
    prior = VelocityPrior(before=None, sigma=0.01)
    shutter = shutter_of(CAMERA, points, points, READOUT_S, INTERVAL_S, prior)
    shutter = shutter._replace(changes=np.concatenate([velocity[1], np.zeros(3)]))
    for image in (0, 1):
        rate = shutter.rate(means_of(velocity, 0.0), image)
        np.testing.assert_allclose(rate, velocity[0] + image * velocity[1])


def test_a_velocity_between_frames_is_exact_for_the_third_degree():
    coefficients = np.random.default_rng(3).normal(size=(4, 6))
    around = [means_of(coefficients, begin) for begin in (-2.0, -1.0, 0.0, 1.0)]
    np.testing.assert_allclose(velocity_between(*around), coefficients[0])


def history_of(rates: np.ndarray) -> Velocities:
    """After motions with these angular velocities (N, 3), rad/s."""
    history, nothing = Velocities(), failed_pose("none")
    for rate in rates:
        motion = replace(nothing, rotation_cam1_from_cam0=so3.exp(rate * INTERVAL_S))
        history.add(motion, INTERVAL_S)
    return history


def test_smooth_velocities_are_continued_and_rough_ones_are_not():
    times = np.arange(30.0)
    smooth = np.outer(0.3 * np.sin(0.3 * times), [1.0, 0.0, 0.0])
    turning = history_of(smooth).prior(INTERVAL_S)
    np.testing.assert_allclose(turning.before, smooth[-1] * INTERVAL_S, atol=1e-12)
    second = np.diff(smooth[:, 0], 2)
    expected = 0.5 * np.sqrt(np.mean(second**2) / 3.0) * INTERVAL_S
    assert turning.sigma == pytest.approx(expected, rel=1e-6)
    rough = np.random.default_rng(1).normal(0.0, 0.1, (30, 3))
    turning = history_of(rough).prior(INTERVAL_S)
    assert turning.before is None
    assert turning.sigma == pytest.approx(np.sqrt(2.0) * 0.1 * INTERVAL_S, rel=0.2)


def test_after_a_cut_only_the_size_of_changes_is_known():
    first = Velocities().prior(INTERVAL_S)
    assert first.before is None
    assert first.sigma == pytest.approx(ANGULAR_ACCELERATION * INTERVAL_S**2)
    assert first.turn_sigma == pytest.approx(DIRECTION_TURN_RATE * INTERVAL_S)
    history = history_of(np.outer(0.3 * np.sin(0.3 * np.arange(30.0)), [1.0, 0.0, 0.0]))
    before = history.prior(INTERVAL_S)
    history.break_off()
    after = history.prior(INTERVAL_S)
    assert before.before is not None
    assert after.before is None
    assert after.sigma > before.sigma
    assert after.turn_sigma == before.turn_sigma


def test_a_wrong_motion_hardly_widens_the_prior():
    rates = np.random.default_rng(2).normal(0.0, 0.1, (30, 3))
    before = history_of(rates).prior(INTERVAL_S).sigma
    rates[20] += 10.0
    assert history_of(rates).prior(INTERVAL_S).sigma < 2.0 * before


def test_the_turn_of_the_direction_is_that_of_earlier_directions():
    history, nothing = Velocities(), failed_pose("none")
    R, turn = so3.exp(np.array([0.0, 0.02, 0.01])), 0.05
    direction = np.array([1.0, 0.0, 0.0])
    for _ in range(10):
        motion = replace(nothing, rotation_cam1_from_cam0=R, direction_cam1_from_cam0=direction)
        history.add(motion, INTERVAL_S)
        # The next direction is turned by 0.05 rad, seen from the axes of the next frame.
        direction = R @ so3.exp(np.array([0.0, 0.0, turn])) @ direction
    expected = turn / np.sqrt(2.0)  # of each of the two coordinates
    assert history.prior(INTERVAL_S).turn_sigma == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("fps", [30.0, 10.0])
def test_first_priors_are_those_of_recordings(shared_data: Path, fps: float):
    recordings = find_trajectories((shared_data / "trajectories",))
    assert recordings
    for recording in recordings.values():
        times = np.arange(recording.timestamps[0], recording.timestamps[-1], 1.0 / fps)
        poses = poses_at_times(recording.timestamps, recording.world_from_body, times)
        history, nothing = Velocities(), failed_pose("none")
        accelerations, turns = [], []
        for before, now in pairwise(poses[np.isfinite(poses[:, 0, 0])]):
            motion = np.linalg.inv(now) @ before
            length = np.linalg.norm(motion[:3, 3])
            if length * fps > 0.1:  # m/s; a direction at rest is noise
                direction = motion[:3, 3] / length
                given = replace(
                    nothing,
                    rotation_cam1_from_cam0=motion[:3, :3],
                    direction_cam1_from_cam0=direction,
                )
                history.add(given, 1.0 / fps)
                prior = history.prior(1.0 / fps)
                accelerations.append(prior.sigma * fps**2)
                turns.append(prior.turn_sigma * fps)
        assert 0.1 * ANGULAR_ACCELERATION < np.median(accelerations) < 2.0 * ANGULAR_ACCELERATION
        assert 0.1 * DIRECTION_TURN_RATE < np.median(turns) < 2.0 * DIRECTION_TURN_RATE


def test_halves_have_the_prior_of_their_pair(monkeypatch: pytest.MonkeyPatch):
    """The prior of the next pair would continue the rotation that the halves are to find."""
    priors = []

    def spied(views: Views, *arguments, **options):
        priors.append(views.velocity_prior)
        return estimate_views(views, *arguments, **options)

    monkeypatch.setattr(sequence, "estimate_views", spied)
    drive = render_drive(Camera.pinhole(160, 120, 120, 120, 79.5, 59.5), frames=6, seed=1)
    odometry = Odometry(drive.camera)
    for frame in drive:
        result = odometry.process(frame.image, frame.timestamp)
    of_pair = priors[-1]
    odometry.split_half(result)
    assert priors[-1] is of_pair
    assert priors[-2] is of_pair


def shaken(seed: int) -> tuple[Views, np.ndarray]:
    """Matches through a rolling shutter whose angular velocity is of second degree; the motion."""
    rng = np.random.default_rng(seed)
    velocity = rng.normal(0.0, 1.0, (3, 3)) * np.array([[0.015], [0.008], [0.001]])
    integral = np.array([1.0, 2.0, 3.0])

    def pose_at(t: np.ndarray) -> np.ndarray:
        theta = (t[:, None] ** integral / integral) @ velocity
        return so3.exp(theta)

    X = rng.uniform([-3.0, -2.5, 1.5], [3.0, 2.5, 6.0], (400, 3))
    translation = np.array([0.03, 0.01, 0.02])

    def seen(image: float) -> np.ndarray:
        row = np.full(len(X), 239.5)
        for _ in range(6):
            t = image + (row / 479.0 - 0.5) * READOUT_S / INTERVAL_S
            pixels = CAMERA.project(
                np.einsum("nij,nj->ni", pose_at(t), X) + t[:, None] * translation
            )
            row = pixels[:, 1]
        return pixels

    points0, points1 = seen(0.0), seen(1.0)
    inside = np.all((points0 > 0) & (points1 > 0), axis=1)
    inside &= np.all((points0 < [639, 479]) & (points1 < [639, 479]), axis=1)
    points0, points1 = (
        points[inside] + rng.normal(0.0, NOISE_PX, (inside.sum(), 2))
        for points in (points0, points1)
    )
    turning = VelocityPrior(before=means_of(velocity, -1.0), sigma=0.002)
    views = Views(points0, points1, CAMERA, CAMERA, None, None, READOUT_S, INTERVAL_S, turning)
    return views, pose_at(np.ones(1))[0]


def test_changes_are_estimated_and_counted_as_unknown():
    """Exact matches of a rendered walk: the estimated changes halve the errors."""
    phone = Camera.pinhole(640, 360, 500.0, 500.0, 319.5, 179.5)
    prior = VelocityPrior(
        None, ANGULAR_ACCELERATION * INTERVAL_S**2, DIRECTION_TURN_RATE * INTERVAL_S
    )
    errors: dict[str, list[float]] = {"estimated": [], "constant": []}
    inside: dict[str, list[bool]] = {"estimated": [], "constant": []}
    for seed in range(2):
        rng = np.random.default_rng(seed)
        walk = RenderedSequence(
            phone,
            handheld_walk(60, 1.0 / INTERVAL_S, seed),
            seed=seed,
            imaging=ImagingOptions(readout_s=READOUT_S),
        )
        for k in range(1, 60, 2):
            points0 = rng.uniform((0, 0), (639, 359), (500, 2))
            points1 = walk.transfer(points0, k - 1, k)
            seen = np.isfinite(points1).all(axis=1)
            points0, points1 = (
                points[seen] + rng.normal(0.0, 0.05, (seen.sum(), 2))
                for points in (points0, points1)
            )
            R = walk.cam1_from_cam0(k - 1, k)[:3, :3]
            given = points0, points1, phone, phone, None, None, READOUT_S, INTERVAL_S
            for name, of in (("estimated", prior), ("constant", None)):
                pose = estimate_views(Views(*given, of), RelativePoseOptions(), 0)
                error = so3.log(R @ pose.rotation_cam1_from_cam0.T)
                square = error @ np.linalg.solve(pose.rotation_covariance, error)
                errors[name].append(float(np.linalg.norm(error)))
                inside[name].append(square < chi2_quantile(0.95, 3))
                if pose.covariance is not None:
                    sigma = np.degrees(direction_sigma(pose.covariance))
                    assert f"1-sigma of {sigma:.2g} deg" in pose.reason
    assert np.median(errors["estimated"]) < 0.5 * np.median(errors["constant"])
    assert np.mean(inside["estimated"]) >= 0.88
    assert np.mean(inside["constant"]) < 0.7


def test_velocities_that_change_are_taken_into_account():
    errors: dict[str, list[float]] = {"changing": [], "constant": []}
    inside = []
    for seed in range(40):
        views, R = shaken(seed)
        for name, given in (("changing", views), ("constant", views._replace(velocity_prior=None))):
            pose = estimate_views(given, RelativePoseOptions(), 0)
            error = so3.log(R @ pose.rotation_cam1_from_cam0.T)
            errors[name].append(float(np.linalg.norm(error)))
            if name == "changing":
                square = error @ np.linalg.solve(pose.rotation_covariance, error)
                inside.append(square < chi2_quantile(0.95, 3))
    assert np.median(errors["changing"]) < 0.5 * np.median(errors["constant"])
    assert np.mean(inside) >= 0.85


def test_a_predicted_motion_is_found_where_the_search_ended_elsewhere():
    """The likelier of two starts, each with its own rotation undone in the rows."""
    lost = 0
    for seed in range(8):
        views, R = shaken(seed)
        options = RelativePoseOptions()
        right = search_views(views, options, 0)
        turned_away = so3.exp(np.array([0.0, 0.01, 0.0])) @ right.fit.R_cam1_from_cam0
        wrong = right.fit.at(turned_away, -right.fit.direction_cam1_from_cam0)
        elsewhere = right._replace(fit=wrong)
        alone = estimate_views(views, options, 0, elsewhere)
        both = estimate_views(views, options, 0, elsewhere._replace(other=right.fit))
        lost += _angle(alone, R) > 3.0 * _angle(both, R)
        again = estimate_views(views, options, 0, right)
        assert so3.angle_between(both.rotation_cam1_from_cam0, again.rotation_cam1_from_cam0) < 1e-4
    assert lost >= 2


def _angle(pose, R: np.ndarray) -> float:
    if pose.rotation_cam1_from_cam0 is None:
        return np.inf
    return so3.angle_between(pose.rotation_cam1_from_cam0, R)


def test_a_prediction_in_another_direction_is_a_second_start():
    views, _ = shaken(0)
    options = RelativePoseOptions()
    fit = search_views(views, options, 0).fit
    R, t = fit.R_cam1_from_cam0, fit.direction_cam1_from_cam0
    assert search_views(views, options, 0, (R, t)).other is None
    across = np.cross(t, [0.0, 0.0, 1.0])
    other = search_views(views, options, 0, (R, across / np.linalg.norm(across))).other
    np.testing.assert_allclose(other.direction_cam1_from_cam0 @ t, 0.0, atol=1e-12)
    # A shutter that is global within a sigma has no rows to correct: both are compared at once.
    camera = views.camera0.with_readout(0.0, 1e-3)
    uncertain = views._replace(camera0=camera, camera1=camera, readout_s=None)
    prediction = R, across / np.linalg.norm(across)
    assert search_views(uncertain, options, 0, prediction).other is None
