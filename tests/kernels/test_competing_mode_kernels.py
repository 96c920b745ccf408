"""Modes in other directions, compared with separate refinements."""

from __future__ import annotations

import numpy as np
import pytest
from kernels_kit import View, matches_of, moved, pose_of, two_views

from farpoint._kernels.competing_modes import compare_with_mode, likeliest_other_mode
from farpoint._kernels.pose import Pose
from farpoint._kernels.refinement import refine_pose

HALF_WIDTH = 300.0


def cost_of(view: View, R: np.ndarray, t: np.ndarray, mixture: np.ndarray) -> float:
    """Negative log likelihood at the local minimum from here, averaged over the poses nearby."""
    pose = pose_of(R, t, mixture)
    refine_pose(matches_of(view, HALF_WIDTH, soft_cheirality=False), 0.1, 10, pose)
    R[:], t[:] = pose.R, pose.t
    return pose.cost[0] + 0.5 * np.linalg.slogdet(pose.normal[:5, :5] + np.eye(5))[1]


def mode_of(view: View, mixture: np.ndarray) -> tuple[float, Pose]:
    own = pose_of(view.R, view.t, mixture)
    mode = pose_of(*(np.full_like(array, np.nan) for array in own[:3]))
    return likeliest_other_mode(
        matches_of(view, HALF_WIDTH, soft_cheirality=False), own, view.R, mode
    ), mode


@pytest.mark.parametrize("seed", range(3))
def test_a_short_flow_has_a_competing_mode(seed):
    view = two_views(
        seed, 40, error_rad=2e-3, noise_rad=2e-3, turn_rad=0.02, baseline_m=0.03, depth_m=(2.0, 3.0)
    )
    mixture = np.array([1.0, 0.05, 0.05, 0.05])
    cost_of(view, view.R, view.t, mixture)  # from here on it is the motion that fits
    log_ratio, mode = mode_of(view, mixture)
    t = mode.t
    assert log_ratio < 30.0
    assert t @ view.t < np.cos(np.radians(30.0))
    own = cost_of(view, view.R.copy(), view.t.copy(), mixture)
    # The best of twelve starts, each refined, on a lattice about the golden angle.
    starts = []
    for k in range(12):
        z, angle = (2 * k + 1) / 12 - 1, k * np.pi * (3.0 - np.sqrt(5.0))
        radius = np.sqrt(1.0 - z * z)
        ended = np.array([radius * np.cos(angle), radius * np.sin(angle), z])
        cost = cost_of(view, view.R.copy(), ended, mixture)
        if ended @ view.t < np.cos(np.radians(30.0)):
            starts.append((cost - own, ended))
    expected, direction = min(starts, key=lambda start: start[0])
    assert log_ratio == pytest.approx(expected, abs=1e-6)
    np.testing.assert_allclose(t, direction, atol=1e-6)
    # Hardly any other start leads to a better one.
    better = 0
    for start in np.random.default_rng(seed).normal(size=(20, 3)):
        other_R, other_t = view.R.copy(), start / np.linalg.norm(start)
        cost = cost_of(view, other_R, other_t, mixture)
        better += other_t @ view.t < np.cos(np.radians(30.0)) and cost - own < log_ratio - 2.0
    assert better <= 3


def test_a_long_flow_has_none_that_comes_near():
    view = two_views(1, 60, error_rad=1e-3, noise_rad=1e-3, turn_rad=0.05)
    log_ratio, _ = mode_of(view, np.array([1.0, 0.05, 0.05, 0.05]))
    assert log_ratio > 50.0


def log_ratio_to(view: View, mixture: np.ndarray, R: np.ndarray, t: np.ndarray) -> float:
    mode = pose_of(R, t, np.full(4, np.nan))
    own = pose_of(view.R, view.t, mixture)
    log_ratio = compare_with_mode(matches_of(view, HALF_WIDTH, soft_cheirality=False), own, mode)
    R[:], t[:] = mode.R, mode.t
    return log_ratio


def test_more_matches_compare_a_mode_as_those_that_found_it():
    view = two_views(
        0, 40, error_rad=2e-3, noise_rad=2e-3, turn_rad=0.02, baseline_m=0.03, depth_m=(2.0, 3.0)
    )
    mixture = np.array([1.0, 0.05, 0.05, 0.05])
    cost_of(view, view.R, view.t, mixture)
    log_ratio, mode = mode_of(view, mixture)
    ended_R, ended_t = mode.R.copy(), mode.t.copy()
    own = cost_of(view, view.R.copy(), view.t.copy(), mixture)
    expected = cost_of(view, mode.R.copy(), mode.t.copy(), mixture) - own
    assert log_ratio_to(view, mixture, ended_R, ended_t) == pytest.approx(expected, abs=1e-6)
    # The noise is estimated again, which changes the log likelihood by a few units.
    assert abs(expected - log_ratio) < 5.0
    np.testing.assert_allclose(ended_t, mode.t, atol=0.05)


def test_a_mode_that_converges_to_the_motion_does_not_compete():
    view = two_views(1, 60, error_rad=1e-3, noise_rad=1e-3, turn_rad=0.05)
    off_R, off_t = moved(view.R, view.t, np.array([1e-3, -1e-3, 1e-3, 0.1, -0.1]))
    assert log_ratio_to(view, np.array([1.0, 0.05, 0.05, 0.05]), off_R, off_t) == np.inf
    assert off_t @ view.t > 0.999
