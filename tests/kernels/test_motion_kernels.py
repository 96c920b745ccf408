"""The fit of a motion from end to end, on exact and on shaken rays."""

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
from farpoint._kernels.covariance import MIN_SIGNAL, covariance_here, step_with_shrunk_flow
from farpoint._kernels.design_effect import CORRELATED_Z, design_effect
from farpoint._kernels.five_rays import SearchBudget
from farpoint._kernels.hypothesis_comparison import MODE_MARGIN, is_secondary_mode
from farpoint._kernels.likelihood import evaluate_residuals
from farpoint._kernels.mixture import LONG_TAIL, SHORT_TAIL
from farpoint._kernels.motion import fit_motion
from farpoint._kernels.motion_refinement import (
    MAX_SEARCHED,
    MotionBuffers,
    MotionSummary,
    refine_motion,
)
from farpoint._kernels.pose import LinearisationPoint, Pose
from farpoint._kernels.refinement import refine_pose
from farpoint._kernels.residual_correlation import patch_correlation
from farpoint.geometry import so3

SPREAD, LEAST_SIGNAL = 500.0, 0.4
EFFORT = SearchBudget(tolerance=3.0, confidence=0.99, min_iterations=16, max_iterations=500)


@kernel
def here(
    seen: LinearisationPoint, right: float, shrunk_flow: bool, least: float, out: np.ndarray
) -> bool:
    return covariance_here(seen, right, shrunk_flow, least, out)


@kernel
def step_by(seen: LinearisationPoint) -> None:
    step_with_shrunk_flow(seen)


def nothing_found(view: View) -> MotionBuffers:
    per_match = np.full((4, len(packed(np.ones(view.size)))), np.nan)
    return MotionBuffers(
        R_far=np.eye(3),
        R=np.empty((3, 3)),
        t=np.empty(3),
        mixture=np.empty(4),
        per_match=per_match,
        labels=np.full(view.size, 9, np.uint8),
        covariance=np.full((5, 5), np.nan),
        R_close=np.full((3, 3), np.nan),
        t_close=np.full(3, np.nan),
        R_secondary=np.full((3, 3), np.nan),
        t_secondary=np.full(3, np.nan),
        scaled_pairs=np.full_like(view.pairs, np.nan),
    )


def find(
    view: View, seed: int = 0, least_signal: float = LEAST_SIGNAL
) -> tuple[MotionBuffers, int, MotionSummary]:
    found, state = nothing_found(view), np.array([seed], np.uint64)
    matches = matches_of(view, SPREAD, found.per_match[0], soft_cheirality=True)
    iterations, *_, numbers = fit_motion(matches, EFFORT, least_signal, state, found)
    assert np.isfinite(numbers).all()
    return found, iterations, MotionSummary(*numbers)


def test_the_motion_of_two_views_is_found_and_settled():
    view = two_views(1, 60, noise_rad=1e-3)
    found, iterations, settled = find(view)
    prior, *per_match = found.per_match
    assert 16 <= iterations <= 500
    assert so3.angle_between(found.R, view.R) < 1e-2
    assert found.t @ view.t > 0.999
    residual, parallax, right = (each[: view.size] for each in per_match)
    assert (right > 0.9).all()
    assert (np.abs(residual) < 1.0).all()
    assert (parallax > 0.0).all()
    # All are plausible, most of them the more for where the others are.
    assert (prior[:60] > 0.1).all()
    assert np.median(prior[:60]) > 5.0
    assert prior[60:].tolist() == [0.0] * (len(prior) - 60)
    assert found.labels.tolist() == [2] * 60
    assert settled.agreeing == settled.beyond_rotation == settled.supporting == 60
    assert settled.sign_log_odds > 100.0
    assert settled.log_odds > 100.0
    assert settled.shows_direction
    assert not settled.scales_with_parallax
    assert not settled.has_shrunk_flow
    pose = pose_of(found.R, found.t, found.mixture)
    refine_pose(matches_of(view, SPREAD, prior, soft_cheirality=True), 1e-3, 20, pose)
    around = np.linalg.slogdet(pose.normal[:5, :5] + np.eye(5))[1]
    assert settled.laplace_factor == pytest.approx(0.5 * around, rel=0.01)


def test_wrong_matches_are_told_apart():
    view = two_views(2, 60, noise_rad=1e-3)
    view.rays1[:12] = np.roll(view.rays1[:12], 1, axis=0)
    found, _, settled = find(view)
    right = found.per_match[3, : view.size]
    assert so3.angle_between(found.R, view.R) < 1e-2
    assert found.t @ view.t > 0.99
    assert (right[12:] > 0.9).all()
    assert np.mean(right[:12] < 0.1) > 0.7
    assert 0.1 < found.mixture[1] < 0.3
    assert settled.agreeing == np.count_nonzero(found.labels) < 54
    assert settled.supporting == np.count_nonzero(right > 0.5)


def test_a_motion_that_is_a_little_off_is_settled_where_it_was_found():
    view = two_views(9, MAX_SEARCHED, noise_rad=1e-3, error_rad=1e-3)
    found, _, before = find(view)
    off_R, off_t = moved(found.R, found.t, np.array([1e-3, -1e-3, 1e-3, 0.02, -0.02]))
    again = nothing_found(view)._replace(R=off_R, t=off_t, mixture=found.mixture.copy())
    numbers = refine_motion(
        matches_of(view, SPREAD, again.per_match[0], soft_cheirality=True), LEAST_SIGNAL, again
    )
    assert so3.angle_between(found.R, off_R) < 1e-4
    np.testing.assert_allclose(off_t, found.t, atol=1e-3)
    assert MotionSummary(*numbers).cost == pytest.approx(before.cost, abs=0.1)
    assert (again.labels == found.labels).mean() > 0.98


def test_the_search_takes_errors_without_a_tail(monkeypatch):
    monkeypatch.setattr(motion_refinement, "_leave_out_none", lambda *_: None)
    matches = matches_of(two_views(1, 40), SPREAD, soft_cheirality=True)
    searched_matches = getattr(
        motion_refinement.searched_matches, "py_func", motion_refinement.searched_matches
    )
    assert (matches.long_tail, searched_matches(matches.pairs, matches).long_tail) == (
        LONG_TAIL,
        SHORT_TAIL,
    )


def test_of_many_matches_every_so_manieth_is_searched():
    view = two_views(5, 2 * MAX_SEARCHED, noise_rad=1e-3)
    # Wrong are some of those that are not searched.
    view.rays1[1:81:2] = np.roll(view.rays1[1:81:2], 1, axis=0)
    found, _, settled = find(view)
    assert found.t @ view.t > 0.999
    assert 2 * MAX_SEARCHED - 42 <= settled.agreeing < 2 * MAX_SEARCHED - 20
    assert (found.per_match[3, : view.size : 2] > 0.5).all()
    assert settled.supporting == MAX_SEARCHED


def linearisation_point(pairs: np.ndarray, found: MotionBuffers) -> LinearisationPoint:
    return LinearisationPoint(
        pairs, found.per_match[0], found.R, found.t, found.mixture, SPREAD, LONG_TAIL
    )


def test_how_sure_the_motion_is_goes_by_how_many_are_right():
    view = two_views(6, 60, noise_rad=1e-3, error_rad=1e-3)
    found, _, settled = find(view)
    expected = np.empty((5, 5))
    right = found.per_match[3, :60].sum()
    assert here(linearisation_point(view.pairs, found), right, False, MIN_SIGNAL, expected)
    assert (settled.has_shrunk_flow, settled.shows_direction, settled.scales_with_parallax) == (
        False,
        True,
        False,
    )
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-12)


@pytest.mark.parametrize(("least_signal", "shows"), [(0.4, True), (0.97, False)])
def test_where_much_of_the_flow_is_noise_it_is_predicted_and_the_motion_moved(least_signal, shows):
    view = two_views(6, 60, noise_rad=1e-3, error_rad=1e-3, baseline_m=0.05)
    found, _, settled = find(view, least_signal=least_signal)
    assert (settled.has_shrunk_flow, settled.shows_direction, settled.scales_with_parallax) == (
        True,
        shows,
        False,
    )
    expected = np.empty((5, 5))
    right = found.per_match[3, :60].sum()
    assert (
        here(linearisation_point(view.pairs, found), right, True, least_signal, expected) == shows
    )
    # The noise of those right is known from before the step, when some may have been less so.
    np.testing.assert_allclose(found.covariance, expected, rtol=0.02)
    # The per-match table is that of the motion after the step.
    pose = pose_of(found.R, found.t, found.mixture)
    refine_pose(matches_of(view, SPREAD, found.per_match[0], soft_cheirality=True), 1e-6, 50, pose)
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


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_what_neighbours_share_is_told_of_the_right_ones(share):
    view, rng = two_views(8, 300, noise_rad=1e-3), np.random.default_rng(8)
    view.rays1[:40] = np.roll(view.rays1[:40], 1, axis=0)
    view.rays1[:, 1] += 3e-3 * share * np.sin(20.0 * view.rays0[:, 0])
    view.rays1[:, 1] += 1e-3 * rng.normal(size=300)
    found, _, settled = find(view)
    rows = np.flatnonzero(found.per_match[3, :300] > 0.5)
    sigma = np.sqrt(found.mixture[0])
    alike = patch_correlation(view.pairs, found.per_match[1], rows, np.arange(300), sigma, 400)
    assert (settled.residual_correlation, settled.correlation_z) == (
        alike,
        np.sqrt(len(rows)) * alike,
    )
    if share:
        assert settled.correlation_z > 2.0 * CORRELATED_Z
        assert (
            settled.design_effect
            == design_effect(view.pairs, found.per_match[1], rows, sigma)
            > 2.0
        )
    else:
        assert (settled.correlation_z < CORRELATED_Z, settled.design_effect) == (True, 1.0)


@pytest.mark.parametrize("matches", [60, 2 * MAX_SEARCHED])
def test_no_array_is_kept(matches):
    view = two_views(6, matches, noise_rad=1e-3, error_rad=1e-3, baseline_m=0.05)
    found, state = nothing_found(view), np.zeros(1, np.uint64)
    given = matches_of(view, SPREAD, found.per_match[0], soft_cheirality=True)
    arrays = given.pairs, given.prior, state, *found
    held = [sys.getrefcount(array) for array in arrays]
    *_, numbers = fit_motion(given, EFFORT, LEAST_SIGNAL, state, found)
    assert MotionSummary(*numbers).has_shrunk_flow  # the longest way
    refine_motion(given, LEAST_SIGNAL, found)
    assert [sys.getrefcount(array) for array in arrays] == held


@pytest.mark.parametrize("matches", [60, 2 * MAX_SEARCHED])
def test_no_room_is_kept(matches):
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


def test_noise_that_grows_with_the_parallax_is_told():
    view = two_views(7, 200, depth_m=(1.0, 20.0))
    flow = np.linalg.norm(view.rays1 - view.rays0 @ view.R.T, axis=1)
    view = shaken(view, 7, 0.1 * (1.0 + (flow / 0.02) ** 2) ** 0.25)
    found, _, settled = find(view)
    assert settled.scales_with_parallax
    residual = np.empty(len(found.per_match[1]))
    evaluate_residuals(
        linearisation_point(found.scaled_pairs, found), residual, *np.empty((2, len(residual)))
    )
    np.testing.assert_allclose(found.per_match[1], residual, rtol=1e-12)


def met(view: View, seed: int) -> MotionBuffers | None:
    """The motion found, if the search has met another one."""
    found, state = nothing_found(view), np.array([seed], np.uint64)
    matches = matches_of(view, SPREAD, found.per_match[0], soft_cheirality=True)
    _, _, has_secondary, *_ = fit_motion(matches, EFFORT, LEAST_SIGNAL, state, found)
    assert (
        has_secondary
        or not np.isfinite(found.t_secondary).all()
        or found.t_secondary @ found.t < 1.0
    )
    return found if has_secondary else None


@kernel
def near(rival: Pose, best: Pose) -> bool:
    return is_secondary_mode(rival, best)


def test_a_pose_that_has_lost_is_a_rival_if_it_comes_near_the_best_elsewhere():
    def pose(cost: float, angle: float) -> Pose:
        t = np.array([np.sin(angle), 0.0, np.cos(angle)])
        return Pose(np.eye(3), t, np.ones(4), np.eye(6), np.array([cost]))

    best = pose(10.0, 0.0)
    assert near(pose(10.0 + MODE_MARGIN - 1.0, 0.4), best)
    assert not near(pose(10.0 + MODE_MARGIN + 1.0, 0.4), best)
    assert not near(pose(10.0, 0.3), best)


def test_another_motion_is_met_where_there_is_one():
    both = 0
    for seed in range(20):
        # A flow of a few times the noise: a rotation can take its place.
        view = two_views(seed, 40, noise_rad=1e-3, error_rad=2e-3, baseline_m=0.05)
        found = met(view, seed)
        if found is None:
            continue
        assert found.t_secondary @ found.t < 0.94
        costs = []
        for R, t in ((found.R, found.t), (found.R_secondary, found.t_secondary)):
            pose = pose_of(R, t, found.mixture)
            refine_pose(matches_of(view, SPREAD, soft_cheirality=True), 1e-3, 20, pose)
            costs.append(pose.cost[0])
        assert abs(costs[1] - costs[0]) < MODE_MARGIN + 10.0
        both += 1
    assert both >= 14  # 16; 12 if it is not the one that lost which is kept
    assert met(two_views(1, 60, noise_rad=1e-3, error_rad=1e-4), 0) is None


def test_the_same_seed_gives_the_same_motion():
    view = two_views(3, 40, error_rad=2e-3)
    (first, *_), (again, *_) = find(view, seed=5), find(view, seed=5)
    for one, other in zip(first[:4], again[:4], strict=True):
        np.testing.assert_array_equal(one, other)


def test_of_matches_at_one_place_nothing_is_sure():
    view = two_views(6, 60, noise_rad=1e-3)
    view.rays0[:], view.rays1[:] = view.rays0[0], view.rays1[0]
    mixture = np.array([1.0, 0.05, 0.05, 0.05])
    found = nothing_found(view)._replace(R=view.R.copy(), t=view.t.copy(), mixture=mixture)
    refine_motion(
        matches_of(view, SPREAD, found.per_match[0], soft_cheirality=True), LEAST_SIGNAL, found
    )
    assert not np.isnan(found.covariance).any()
    assert found.covariance[:3, :3].diagonal().max() > 1.0
