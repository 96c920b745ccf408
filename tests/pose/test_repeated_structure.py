"""A court of walls with windows: one window is taken for the next."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from pose_kit import rotation_error

from farpoint import Camera, PoseStatus, estimate_relative_pose
from farpoint._kernels.motion_refinement import refine_motion
from farpoint.geometry import so3, sphere
from farpoint.pose import general_motion
from farpoint.pose.matches import matches_from_points
from farpoint.pose.options import DEFAULTS

CAMERA = Camera.pinhole(3072, 2048, 2760.0, 2760.0, 1535.5, 1023.5)
CENTRES = np.array([[0.0, 0.0, 22.0], [-7.0, 0.0, 17.0], [7.0, 0.0, 17.0]])
ALONG = np.array([[1.0, 0.0, 0.0], [0.35, 0.0, 0.94], [0.35, 0.0, -0.94]])
HALF_WIDTHS = np.array([6.0, 3.0, 3.0])
WINDOWS_M, STOREY_M = 1.5, 2.7


class Court(NamedTuple):
    points0: np.ndarray
    points1: np.ndarray
    R: np.ndarray
    t: np.ndarray


def court(seed: int, matches: int, repeated: float, *, whole: bool = False) -> Court:
    """Two stills 5 m and 14 degrees apart, 0.3 px of noise; this share is of another window.

    Single matches, of a window on either side; or all of a window, of the next.
    """
    rng, n = np.random.default_rng(seed), 3 * matches
    wall = rng.integers(0, 3, n)
    along, up = rng.uniform(-1.0, 1.0, n) * HALF_WIDTHS[wall], rng.uniform(-4.0, 4.0, n)
    X = CENTRES[wall] + along[:, None] * ALONG[wall]
    X += np.c_[np.zeros(n), up, rng.normal(0.0, 0.15, n)]
    if whole:
        places = np.c_[wall, np.floor(along / WINDOWS_M), np.floor(up / STOREY_M)]
        windows, window = np.unique(places, axis=0, return_inverse=True)
        shift = WINDOWS_M * (rng.uniform(size=len(windows)) < repeated)[window.ravel()]
    else:
        is_repeated = rng.uniform(size=n) < repeated
        shift = WINDOWS_M * rng.choice([-1.0, 1.0, 2.0], n) * is_repeated
    R = so3.exp(np.array([0.02, -0.25, 0.01]) + rng.normal(0.0, 0.02, 3))
    centre = np.array([5.0, 0.3, 1.5]) + rng.normal(0.0, 0.3, 3)
    views = X, (X + shift[:, None] * ALONG[wall] - centre) @ R.T
    points = [CAMERA.project(view) + rng.normal(0.0, 0.3, (n, 2)) for view in views]
    seen = np.all([(p > 0.0).all(1) & (p < CAMERA.size).all(1) for p in points], axis=0)
    points0, points1 = (p[seen][:matches] for p in points)
    assert len(points0) == matches
    return Court(points0, points1, R, sphere.normalize(-R @ centre))


@pytest.mark.parametrize(("matches", "repeated"), [(150, 0.4), (250, 0.45), (500, 0.45)])
def test_a_window_taken_for_the_next_is_a_wrong_match(matches, repeated):
    # With wrong matches anywhere, a pose between right and repeated ones, with more noise, is the
    # likelier: 6 to 12 of 40 are off by more than a degree.
    off_deg = []
    for seed in range(30):
        scene = court(seed, matches, repeated)
        pose = estimate_relative_pose(scene.points0, scene.points1, CAMERA)
        assert pose.status is PoseStatus.OK
        off_deg.append(np.degrees(np.linalg.norm(rotation_error(pose, scene.R))))
    assert max(off_deg) < 1.0
    assert np.median(off_deg) < 0.12


def test_repeated_windows_with_a_common_motion_have_correlated_residuals():
    # Half of the matches are of another window, and the likeliest motion lies between.
    far_off = 0
    for seed in range(240):
        scene = court(seed, 500, 0.5, whole=True)
        pose = estimate_relative_pose(scene.points0, scene.points1, CAMERA)
        assert pose.status is not PoseStatus.FAILED
        far_off += np.degrees(np.linalg.norm(rotation_error(pose, scene.R))) > 1.0
    assert far_off <= 30  # 25; 54 of the likeliest


@pytest.mark.parametrize("first_is_right", [False, True])
def test_of_two_motions_that_some_matches_allow_all_choose(monkeypatch, first_is_right):
    scene = court(1, 400, 0.2)
    matches = matches_from_points(scene.points0, scene.points1, CAMERA, CAMERA)
    fit = general_motion.fit_general_motion(matches, 1.0, DEFAULTS, np.array([1], np.uint64))
    off = so3.exp(np.array([0.0, 0.02, 0.0])) @ scene.R
    tilted = sphere.normalize(scene.t + np.array([0.0, 0.4, 0.0]))
    motions = [(scene.R, scene.t), (off, tilted)]
    first, second = motions if first_is_right else motions[::-1]

    def found_both(judged, _effort, least_signal, _state, found):
        found.R_far[:], found.mixture[:] = fit.far_rotation_cam1_from_cam0, fit.noise.array
        found.R[:], found.t[:] = first
        found.R_close[:], found.t_close[:] = second
        return 16, False, False, True, refine_motion(judged, least_signal, found)

    monkeypatch.setattr(general_motion, "fit_motion", found_both)
    chosen = general_motion.fit_general_motion(matches, 1.0, DEFAULTS, np.array([1], np.uint64))
    assert so3.angle_between(chosen.R_cam1_from_cam0, scene.R) < 2e-3
    assert (chosen.secondary_mode is None) == first_is_right
