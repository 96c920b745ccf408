"""The window: derivatives, marginalisation, noise that adds up, and the tables behind it."""

from __future__ import annotations

import numpy as np
import pytest
from drive_kit import CAMERA, EXACT, Drive, cloud, forward, poses_of
from hand_kit import FPS, tracks_of

from farpoint.camera import Camera, KannalaBrandt
from farpoint.geometry import so3
from farpoint.path.information import System, inverse, solution
from farpoint.path.keyframe import Keyframe
from farpoint.path.options import LensRefinementOptions, PathOptions
from farpoint.path.prior import Prior
from farpoint.path.residuals import Normal, Poses
from farpoint.path.velocities import correct_velocities
from farpoint.path.window import Window

FISHEYE = Camera(
    model=KannalaBrandt(fx=300.0, fy=300.0, cx=319.5, cy=239.5, k1=0.01, k2=-0.005), size=(640, 480)
)


def window_of(camera: Camera = CAMERA, frames: int = 12, readout_s: float = 0.02) -> Window:
    """A window in the midst of a handheld recording, lens and shutter among its unknowns."""
    drive = Drive(PathOptions(keyframe_flow_px=8.0), LensRefinementOptions(), camera, fps=FPS)
    for tracks in tracks_of(camera, frames, seed=3, readout_s=readout_s):
        drive.add(tracks)
    window = drive.builder._window
    assert window is not None
    assert len(window) > 4
    return window


def cost_of(window: Window) -> float:
    """Of the data alone."""
    poses = Poses.of(window.frames)
    residuals = window._residuals(poses)
    return residuals.cost(residuals.linear(poses))


def normal_of(window: Window) -> Normal:
    """Normal equations of the data where the window is now."""
    poses = Poses.of(window.frames)
    residuals = window._residuals(poses)
    return residuals.normal(residuals.linear(poses), window.landmarks.has_depth)


@pytest.mark.parametrize("camera", [CAMERA, FISHEYE], ids=["pinhole", "fisheye"])
def test_the_gradient_is_the_derivative_of_the_cost(camera):
    window = window_of(camera)
    window.lens.relinearise()  # what its derivatives leave out is of second order in its change
    window.landmarks.update_rays()
    window.design_effect = 12.0  # sets the sigmas that differences are compared with
    normal = normal_of(window)
    still = normal._replace(point_h=np.ones_like(normal.point_h), point_g=0.0 * normal.point_g)
    still = still._replace(coupling=0.0 * normal.coupling)
    common = 6 * len(window)
    steps = [(k, 1e-6) for k in range(6, common, 5)]
    steps += [(k, 1e-3) for k in range(common, common + window.lens.size)]
    steps += [(common + window.lens.size, 1e-5)]
    for index, size in steps:
        costs = []
        for sign in (1.0, -1.0):
            before = window._state()
            step = np.zeros(len(normal.g))
            step[index] = sign * size
            window._move(step, still)
            costs.append(cost_of(window))
            window._restore(before)
        slope = (costs[0] - costs[1]) / (2.0 * size)
        scale = np.sqrt(normal.H[index, index])
        assert slope == pytest.approx(normal.g[index], rel=5e-3, abs=1e-2 * scale)


def test_the_gradient_of_distances_is_the_derivative_of_the_cost():
    window = window_of()
    marks = window.landmarks
    normal = normal_of(window)
    for row in np.flatnonzero(marks.has_depth)[::17]:
        size, costs, kept = 1e-5 * marks.s[row], [], marks.s
        for sign in (1.0, -1.0):
            marks.s = kept.copy()
            marks.s[row] += sign * size
            costs.append(cost_of(window))
        marks.s = kept
        slope = (costs[0] - costs[1]) / (2.0 * size)
        assert slope == pytest.approx(
            normal.point_g[row], rel=5e-3, abs=1e-2 * np.sqrt(normal.point_h[row])
        )


def test_moving_the_world_costs_nothing():
    # The first six directions of the gauge: information along them is zero, wherever the poses are.
    window = window_of()
    normal = normal_of(window)
    whole = np.zeros((len(normal.g), 6))
    for slot in range(len(window)):
        whole[6 * slot : 6 * slot + 6] = np.eye(6)
    size = np.sqrt(np.diag(normal.H)[:-1].max())
    assert np.abs(normal.H @ whole).max() < 1e-9 * size**2


def test_a_removed_keyframe_leaves_its_information():
    """The covariance of those that stay is the one of before, where all its points have ended."""
    window = window_of()
    marks = window.landmarks
    # Points of the first keyframe alone: then nothing is left out when it goes.
    marks.keep(marks.slot[marks.anchor] == 0)
    window.solve(1)
    window._linear = None  # taken anew, at the lens as it is
    reduced = normal_of(window).reduced(0.0)
    whole = window._with_prior(reduced, window._deviation(), window._scale.gauge(window.frames))
    window.remove(0, np.empty(0, np.int64))
    kept = np.linalg.inv(window._prior.at(window._deviation()).H)
    np.testing.assert_allclose(kept, np.linalg.inv(whole.H)[6:, 6:], rtol=1e-3, atol=1e-12)


def test_the_relative_pose_of_two_keyframes_is_surer_than_either():
    drive = Drive(PathOptions(keyframe_flow_px=8.0))
    poses = poses_of(forward(30), np.zeros((30, 3)))
    for tracks in cloud(poses, noise_px=0.2).tracks():
        drive.add(tracks)
    window = drive.builder._window
    frames = [frame.frame for frame in window.frames]
    found = drive.builder.relative_pose(frames[-2], frames[-1])
    assert found is not None
    motion, covariance = found
    first, second = window.frames[-2], window.frames[-1]
    np.testing.assert_allclose(motion[:3, :3], second.R.T @ first.R, atol=1e-12)
    np.testing.assert_allclose(second.R @ motion[:3, 3] + second.p, first.p, atol=1e-9)
    assert np.linalg.eigvalsh(covariance).min() > 0.0
    assert window.has_marginalised
    assert len(window.covariance) == 6 * len(window) + 1
    error = np.linalg.inv(poses[frames[-1]]) @ poses[frames[-2]]
    scale = np.linalg.norm(motion[:3, 3]) / np.linalg.norm(error[:3, 3])
    off = motion[:3, 3] / scale - error[:3, 3]
    assert np.linalg.norm(off) * scale < 5.0 * np.sqrt(np.trace(covariance[3:, 3:]))
    alone = window.covariance_of(window.newest_by_state(), window.frames[-1].p)
    assert np.trace(covariance[:3, :3]) < np.trace(alone[:3, :3])
    assert drive.builder.relative_pose(frames[0] - 1000, frames[-1]) is None


def test_memory_and_time_do_not_grow_with_the_drive():
    sizes = []
    drive = Drive(PathOptions(keyframe_flow_px=8.0))
    scene = cloud(poses_of(forward(90), np.zeros((90, 3))), count=6000)
    for tracks in scene.tracks():
        drive.add(tracks)
        marks = drive.builder._window.landmarks
        sizes.append((len(marks.ids), len(marks.point)))
    early, delay_s = np.max(sizes[25:45], axis=0), np.max(sizes[70:], axis=0)
    assert (delay_s < 1.3 * early).all()


def test_a_lens_that_is_believed_has_no_unknowns():
    drive = Drive(lens=EXACT)
    for tracks in cloud(poses_of(forward(6), np.zeros((6, 3)))).tracks():
        drive.add(tracks)
    report = drive.builder.report()
    assert report is not None
    assert not report.refined
    assert report.camera.model == CAMERA.model
    assert set(report.sigma.values()) == {0.0}
    assert report.readout_s == pytest.approx(0.0, abs=1e-9)


def test_rotation_vectors_of_the_prior_are_those_of_so3():
    from farpoint.path.prior import rotation_vectors

    vectors = np.random.default_rng(0).normal(0.0, 0.8, (40, 3))
    vectors[0] = 0.0
    np.testing.assert_allclose(rotation_vectors(so3.exp(vectors)), vectors, atol=1e-12)


def test_eliminating_a_pose_keeps_the_covariance_and_the_solution_of_the_rest():
    rng = np.random.default_rng(4)
    frames = [Keyframe(frame=k, timestamp=0.1 * k, R=np.eye(3), p=np.zeros(3)) for k in range(3)]
    common = np.zeros(2)
    prior = Prior(common, np.eye(2))
    for frame in frames:
        prior.add_pose(frame)
    J = rng.normal(size=(60, 20))
    H, g = J.T @ J, rng.normal(size=20)
    rest = np.delete(np.arange(20), np.arange(6, 12))
    prior.replace(System(H, g), 1, Poses.of([frames[0], frames[2]]), common)
    found = prior.at(np.zeros(14))
    np.testing.assert_allclose(np.linalg.inv(found.H), np.linalg.inv(H)[np.ix_(rest, rest)])
    np.testing.assert_allclose(np.linalg.solve(found.H, found.g), np.linalg.solve(H, g)[rest])


def test_solutions_and_inverses_of_systems_whose_units_span_many_orders():
    rng = np.random.default_rng(5)
    J, units = rng.normal(size=(60, 20)), 10.0 ** rng.uniform(-6, 6, 20)
    H, g = (J.T @ J) * np.outer(units, units), rng.normal(size=20) * units
    np.testing.assert_allclose(
        inverse(H) * np.outer(units, units), np.linalg.inv(J.T @ J), rtol=1e-6
    )
    step = solution(System(H, g), 0.0)
    np.testing.assert_allclose(step * units, -np.linalg.solve(J.T @ J, g / units), rtol=1e-9)
    H[3, 3] = -1.0  # not positive: there is no step, and no error
    assert not solution(System(H, g), 0.0).any()
    assert np.isfinite(inverse(H)).all()


def test_velocities_follow_the_solution():
    window = window_of()
    start = Poses.of(window.frames)
    drift, turn = np.array([0.3, -0.2, 0.5]), np.array([0.02, 0.01, -0.03])
    for frame in window.frames:
        since = frame.timestamp - window.frames[0].timestamp
        frame.p, frame.R = frame.p + since * drift, so3.exp(since * turn) @ frame.R
    correct_velocities(window.frames, start)
    for frame, before in zip(window.frames, start.twist, strict=True):
        np.testing.assert_allclose(frame.twist - before, np.concatenate([turn, drift]), atol=1e-6)


def test_velocities_are_those_of_the_positions_once_there_is_a_scale():
    # The camera turns on the spot at first; the first displacement has the length of the unit.
    steps, turns = np.zeros((11, 3)), np.zeros((11, 3))
    steps[3:], turns[:, 1] = (0.01, 0.0, 0.005), 0.03
    drive = Drive(PathOptions(keyframe_flow_px=8.0))
    for tracks in cloud(poses_of(steps, turns)).tracks():
        drive.add(tracks)
    window = drive.builder._window
    assert window is not None
    times, poses = [frame.timestamp for frame in window.frames], Poses.of(window.frames)
    mean = np.gradient(poses.p, times, axis=0)
    fastest = np.linalg.norm(mean, axis=1).max()
    assert fastest > 0.0
    assert np.linalg.norm(poses.twist[:, 3:] - mean, axis=1).max() < 0.03 * fastest
