"""Parallax of a motion: exact without noise, and with the derivatives that it states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from drive_kit import CAMERA, cloud, forward, motion_of, poses_of

from farpoint.geometry import so3, sphere
from farpoint.trajectory.parallax import measure_parallax


def a_pair(noise_px: float = 0.0, seed: int = 0):
    poses = poses_of(forward(1), np.array([[0.01, -0.02, 0.005]]))
    (tracks,) = cloud(poses, noise_px=noise_px, seed=seed).tracks()
    return poses, tracks, motion_of(tracks)


def test_inverse_distances_are_those_of_the_points():
    poses = poses_of(forward(1), np.array([[0.01, -0.02, 0.005]]))
    scene = cloud(poses, noise_px=0.0)
    (tracks,) = scene.tracks()
    motion = motion_of(tracks)
    parallax = measure_parallax(CAMERA, tracks, motion)
    row = np.searchsorted(tracks.ids, parallax.ids)
    pixels = tracks.points0[row]
    projected = np.nan_to_num(CAMERA.project(scene.points), nan=1e9)
    nearest = np.argmin(np.linalg.norm(projected[None] - pixels[:, None], axis=2), axis=1)
    truth = np.linalg.norm(poses[1, :3, 3]) / np.linalg.norm(scene.points[nearest], axis=1)
    np.testing.assert_allclose(parallax.measured(), truth, rtol=1e-5, atol=1e-7)
    # Taken around anything near, it is the same to first order.
    around = parallax.around(truth * 1.001)
    np.testing.assert_allclose(around.inverse, truth, rtol=1e-5, atol=1e-7)


def test_another_motion_makes_the_distances_what_is_stated():
    _, tracks, motion = a_pair()
    parallax = measure_parallax(CAMERA, tracks, motion)
    stated = parallax.around(parallax.measured()).by_motion
    for axis in range(5):
        step = np.zeros(5)
        step[axis] = 1e-6
        after = []
        for sign in (1.0, -1.0):
            moved = replace(
                motion,
                rotation_cam1_from_cam0=so3.exp(sign * step[:3]) @ motion.rotation_cam1_from_cam0,
                direction_cam1_from_cam0=sphere.retract(
                    motion.direction_cam1_from_cam0, motion.direction_basis, sign * step[3:]
                ),
            )
            after.append(measure_parallax(CAMERA, tracks, moved).measured())
        derivative = (after[1] - after[0]) / 2e-6
        np.testing.assert_allclose(stated[:, axis], derivative, rtol=1e-3, atol=2e-4)


def test_the_noise_of_the_distances_is_what_is_stated():
    deviations = []
    poses = poses_of(forward(1), np.zeros((1, 3)))
    (exact,) = cloud(poses, noise_px=0.0).tracks()
    motion = motion_of(exact)
    truth = measure_parallax(CAMERA, exact, motion).measured()
    rng = np.random.default_rng(1)
    noise_px = 0.05
    known = replace(motion, noise_px=noise_px / np.sqrt(2.0))  # half of the variance in each image
    for _ in range(200):
        found = exact.points1 + noise_px * rng.normal(size=exact.points1.shape)
        noisy = replace(exact, points1=found)
        around = measure_parallax(CAMERA, noisy, known).around(truth)
        deviations.append((around.inverse - truth) / np.sqrt(around.variance))
    assert abs(np.std(deviations) - 1.0) < 0.01
    assert abs(np.mean(deviations)) < 0.01
