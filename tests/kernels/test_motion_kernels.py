"""Fit of a general motion, on exact and on noisy rays."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from kernels_kit import View, matches_of, moved, packed, pose_of, shaken, two_views
from numba.core import config
from numba.core.runtime import _nrt_python
from numba.core.runtime.nrt import rtsys

from farpoint._kernels import motion_refinement
from farpoint._kernels.compile import kernel
from farpoint._kernels.constants import (
    LONG_TAIL,
    MAX_SEARCHED,
    MIN_SIGNAL,
    MODE_MARGIN,
    SHORT_TAIL,
)
from farpoint._kernels.covariance import covariance_here, step_with_shrunk_flow
from farpoint._kernels.five_rays import SearchBudget
from farpoint._kernels.hypothesis_comparison import is_secondary_mode
from farpoint._kernels.likelihood import evaluate_residuals
from farpoint._kernels.motion import fit_motion
from farpoint._kernels.motion_refinement import MotionBuffers, MotionSummary, refine_motion
from farpoint._kernels.pose import LinearisationPoint, Pose
from farpoint._kernels.refinement import refine_pose
from farpoint.geometry import so3

HALF_WIDTH, LEAST_SIGNAL = 500.0, 0.4
BUDGET = SearchBudget(tolerance=3.0, confidence=0.99, min_iterations=16, max_iterations=500)


@kernel
def here(
    point: LinearisationPoint, inlier: float, shrunk_flow: bool, least: float, out: np.ndarray
) -> bool:
    return covariance_here(point, inlier, shrunk_flow, least, out)


@kernel
def step_by(point: LinearisationPoint) -> None:
    step_with_shrunk_flow(point)


def empty_buffers(view: View) -> MotionBuffers:
    per_match = np.full((4, len(packed(np.ones(view.size)))), np.nan)
    return MotionBuffers(
        R_far=np.eye(3),
        R=np.empty((3, 3)),
        t=np.empty(3),
        mixture=np.empty(4),
        per_match=per_match,
        labels=np.full(view.size, 9, np.uint8),
        covariance=np.full((5, 5), np.nan),
        R_secondary=np.full((3, 3), np.nan),
        t_secondary=np.full(3, np.nan),
        scaled_pairs=np.full_like(view.pairs, np.nan),
    )


def find(
    view: View, seed: int = 0, least_signal: float = LEAST_SIGNAL
) -> tuple[MotionBuffers, int, MotionSummary]:
    found, state = empty_buffers(view), np.array([seed], np.uint64)
    matches = matches_of(view, HALF_WIDTH, found.per_match[0], soft_cheirality=True)
    iterations, *_, numbers = fit_motion(matches, BUDGET, least_signal, state, found)
    assert np.isfinite(numbers).all()
    return found, iterations, numbers


def test_the_motion_of_two_views_is_found_and_refined():
    view = two_views(1, 60, noise_rad=1e-3)
    found, iterations, summary = find(view)
    prior, *per_match = found.per_match
    assert 16 <= iterations <= 500
    assert so3.angle_between(found.R, view.R) < 1e-2
    assert found.t @ view.t > 0.999
    residual, parallax, inlier = (each[: view.size] for each in per_match)
    assert (inlier > 0.9).all()
    assert (np.abs(residual) < 1.0).all()
    assert (parallax > 0.0).all()
    # All have a prior above zero, most of them a high one.
    assert (prior[:60] > 0.1).all()
    assert np.median(prior[:60]) > 5.0
    assert prior[60:].tolist() == [0.0] * (len(prior) - 60)
    assert found.labels.tolist() == [2] * 60
    assert summary.agreeing == summary.beyond_rotation == summary.supporting == 60
    assert summary.sign_log_odds > 100.0
    assert summary.log_odds > 100.0
    assert summary.shows_direction
    assert not summary.scales_with_parallax
    assert not summary.has_shrunk_flow
    pose = pose_of(found.R, found.t, found.mixture)
    refine_pose(matches_of(view, HALF_WIDTH, prior, soft_cheirality=True), 1e-3, 20, pose)
    around = np.linalg.slogdet(pose.normal[:5, :5] + np.eye(5))[1]
    assert summary.laplace_factor == pytest.approx(0.5 * around, rel=0.01)


def test_outliers_are_identified():
    view = two_views(2, 60, noise_rad=1e-3)
    view.rays1[:12] = np.roll(view.rays1[:12], 1, axis=0)
    found, _, summary = find(view)
    inlier = found.per_match[3, : view.size]
    assert so3.angle_between(found.R, view.R) < 1e-2
    assert found.t @ view.t > 0.99
    assert (inlier[12:] > 0.9).all()
    assert np.mean(inlier[:12] < 0.1) > 0.7
    assert 0.1 < found.mixture[1] < 0.3
    assert summary.agreeing == np.count_nonzero(found.labels) < 54
    assert summary.supporting == np.count_nonzero(inlier > 0.5)


def test_a_refinement_from_nearby_ends_at_the_same_motion():
    view = two_views(9, MAX_SEARCHED, noise_rad=1e-3, error_rad=1e-3)
    found, _, before = find(view)
    off_R, off_t = moved(found.R, found.t, np.array([1e-3, -1e-3, 1e-3, 0.02, -0.02]))
    again = empty_buffers(view)._replace(R=off_R, t=off_t, mixture=found.mixture.copy())
    numbers = refine_motion(
        matches_of(view, HALF_WIDTH, again.per_match[0], soft_cheirality=True), LEAST_SIGNAL, again
    )
    assert so3.angle_between(found.R, off_R) < 1e-4
    np.testing.assert_allclose(off_t, found.t, atol=1e-3)
    assert numbers.cost == pytest.approx(before.cost, abs=0.1)
    assert (again.labels == found.labels).mean() > 0.98


def test_the_search_uses_the_short_tail(monkeypatch):
    monkeypatch.setattr(motion_refinement, "_leave_out_none", lambda *_: None)
    matches = matches_of(two_views(1, 40), HALF_WIDTH, soft_cheirality=True)
    searched_matches = getattr(
        motion_refinement.searched_matches, "py_func", motion_refinement.searched_matches
    )
    assert (matches.long_tail, searched_matches(matches.pairs, matches).long_tail) == (
        LONG_TAIL,
        SHORT_TAIL,
    )


def test_an_even_subsample_of_many_matches_is_searched():
    view = two_views(5, 2 * MAX_SEARCHED, noise_rad=1e-3)
    # Some matches outside the subsample are outliers.
    view.rays1[1:81:2] = np.roll(view.rays1[1:81:2], 1, axis=0)
    found, _, summary = find(view)
    assert found.t @ view.t > 0.999
    assert 2 * MAX_SEARCHED - 42 <= summary.agreeing < 2 * MAX_SEARCHED - 20
    assert (found.per_match[3, : view.size : 2] > 0.5).all()
    assert summary.supporting == MAX_SEARCHED


def linearisation_point(pairs: np.ndarray, found: MotionBuffers) -> LinearisationPoint:
    return LinearisationPoint(
        pairs, found.per_match[0], found.R, found.t, found.mixture, HALF_WIDTH, LONG_TAIL
    )


def test_the_covariance_is_that_of_the_expected_number_of_inliers():
    view = two_views(6, 60, noise_rad=1e-3, error_rad=1e-3)
    found, _, summary = find(view)
    expected = np.empty((5, 5))
    inlier = found.per_match[3, :60].sum()
    assert here(linearisation_point(view.pairs, found), inlier, False, MIN_SIGNAL, expected)
    assert (summary.has_shrunk_flow, summary.shows_direction, summary.scales_with_parallax) == (
        False,
        True,
        False,
    )
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-12)


@pytest.mark.parametrize(("least_signal", "shows"), [(0.4, True), (0.97, False)])
def test_flow_that_is_mostly_noise_is_shrunk_and_the_motion_takes_a_step(least_signal, shows):
    view = two_views(6, 60, noise_rad=1e-3, error_rad=1e-3, baseline_m=0.05)
    found, _, summary = find(view, least_signal=least_signal)
    assert (summary.has_shrunk_flow, summary.shows_direction, summary.scales_with_parallax) == (
        True,
        shows,
        False,
    )
    expected = np.empty((5, 5))
    inlier = found.per_match[3, :60].sum()
    assert (
        here(linearisation_point(view.pairs, found), inlier, True, least_signal, expected) == shows
    )
    # The number of inliers is from before the step, when it may have been a little less.
    np.testing.assert_allclose(found.covariance, expected, rtol=0.02)
    # The per-match table is that of the motion after the step.
    pose = pose_of(found.R, found.t, found.mixture)
    refine_pose(
        matches_of(view, HALF_WIDTH, found.per_match[0], soft_cheirality=True), 1e-6, 50, pose
    )
    likeliest = found._replace(R=pose.R, t=pose.t)
    assert so3.angle_between(likeliest.R, found.R) > 2e-5
    step_by(linearisation_point(view.pairs, likeliest))
    assert so3.angle_between(likeliest.R, found.R) < 4e-6
    np.testing.assert_allclose(likeliest.t, found.t, atol=1e-3)
    residual = np.empty(len(found.per_match[1]))
    evaluate_residuals(
        linearisation_point(view.pairs, found), residual, *np.empty((2, len(residual)))
    )
    np.testing.assert_allclose(found.per_match[1], residual, rtol=1e-12)


@pytest.mark.parametrize("matches", [60, 2 * MAX_SEARCHED])
def test_no_array_is_kept(matches):
    view = two_views(6, matches, noise_rad=1e-3, error_rad=1e-3, baseline_m=0.05)
    found, state = empty_buffers(view), np.zeros(1, np.uint64)
    given = matches_of(view, HALF_WIDTH, found.per_match[0], soft_cheirality=True)
    arrays = given.pairs, given.prior, state, *found
    held = [sys.getrefcount(array) for array in arrays]
    *_, numbers = fit_motion(given, BUDGET, LEAST_SIGNAL, state, found)
    assert numbers.has_shrunk_flow  # the longest way
    refine_motion(given, LEAST_SIGNAL, found)
    assert [sys.getrefcount(array) for array in arrays] == held


@pytest.mark.parametrize("matches", [60, 2 * MAX_SEARCHED])
def test_no_memory_is_kept(matches):
    view = two_views(6, matches, noise_rad=1e-3, error_rad=1e-3, baseline_m=0.05)
    _nrt_python.memsys_enable_stats()
    try:
        before = rtsys.get_allocation_stats()
        find(view)
        after = rtsys.get_allocation_stats()
    finally:
        _nrt_python.memsys_disable_stats()
    made, freed = (getattr(after, name) - getattr(before, name) for name in ("mi_alloc", "mi_free"))
    assert made == freed
    assert made > 0 or config.DISABLE_JIT


def test_noise_that_scales_with_parallax_is_found():
    view = two_views(7, 200, depth_m=(1.0, 20.0))
    flow = np.linalg.norm(view.rays1 - view.rays0 @ view.R.T, axis=1)
    view = shaken(view, 7, 0.1 * (1.0 + (flow / 0.02) ** 2) ** 0.25)
    found, _, summary = find(view)
    assert summary.scales_with_parallax
    residual = np.empty(len(found.per_match[1]))
    evaluate_residuals(
        linearisation_point(found.scaled_pairs, found), residual, *np.empty((2, len(residual)))
    )
    np.testing.assert_allclose(found.per_match[1], residual, rtol=1e-12)


def found_with_mode(view: View, seed: int) -> MotionBuffers | None:
    """The motion found, if the search has found a secondary mode."""
    found, state = empty_buffers(view), np.array([seed], np.uint64)
    matches = matches_of(view, HALF_WIDTH, found.per_match[0], soft_cheirality=True)
    _, _, has_secondary, *_ = fit_motion(matches, BUDGET, LEAST_SIGNAL, state, found)
    assert (
        has_secondary
        or not np.isfinite(found.t_secondary).all()
        or found.t_secondary @ found.t < 1.0
    )
    return found if has_secondary else None


@kernel
def near(secondary: Pose, best: Pose) -> bool:
    return is_secondary_mode(secondary, best)


def test_a_secondary_mode_is_within_the_margin_and_in_another_direction():
    def pose(cost: float, angle: float) -> Pose:
        t = np.array([np.sin(angle), 0.0, np.cos(angle)])
        return Pose(np.eye(3), t, np.ones(4), np.eye(6), np.array([cost]))

    best = pose(10.0, 0.0)
    assert near(pose(10.0 + MODE_MARGIN - 1.0, 0.4), best)
    assert not near(pose(10.0 + MODE_MARGIN + 1.0, 0.4), best)
    assert not near(pose(10.0, 0.3), best)


def test_a_secondary_mode_is_found_where_there_is_one():
    both = 0
    for seed in range(20):
        # A flow of a few times the noise: a rotation imitates it.
        view = two_views(seed, 40, noise_rad=1e-3, error_rad=2e-3, baseline_m=0.05)
        found = found_with_mode(view, seed)
        if found is None:
            continue
        assert found.t_secondary @ found.t < 0.94
        costs = []
        for R, t in ((found.R, found.t), (found.R_secondary, found.t_secondary)):
            pose = pose_of(R, t, found.mixture)
            refine_pose(matches_of(view, HALF_WIDTH, soft_cheirality=True), 1e-3, 20, pose)
            costs.append(pose.cost[0])
        assert abs(costs[1] - costs[0]) < MODE_MARGIN + 10.0
        both += 1
    assert both >= 14  # 16; 12 if it is not the one that lost which is kept
    assert found_with_mode(two_views(1, 60, noise_rad=1e-3, error_rad=1e-4), 0) is None


def test_the_same_seed_gives_the_same_motion():
    view = two_views(3, 40, error_rad=2e-3)
    (first, *_), (again, *_) = find(view, seed=5), find(view, seed=5)
    for one, other in zip(first[:4], again[:4], strict=True):
        np.testing.assert_array_equal(one, other)


def test_matches_at_one_place_have_a_large_covariance():
    view = two_views(6, 60, noise_rad=1e-3)
    view.rays0[:], view.rays1[:] = view.rays0[0], view.rays1[0]
    mixture = np.array([1.0, 0.05, 0.05, 0.05])
    found = empty_buffers(view)._replace(R=view.R.copy(), t=view.t.copy(), mixture=mixture)
    refine_motion(
        matches_of(view, HALF_WIDTH, found.per_match[0], soft_cheirality=True), LEAST_SIGNAL, found
    )
    assert not np.isnan(found.covariance).any()
    assert found.covariance[:3, :3].diagonal().max() > 1.0
