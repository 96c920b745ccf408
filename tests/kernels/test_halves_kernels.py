"""By how much two halves of the matches disagree, held against the same written in NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from kernels_kit import matches_of, packed, pose_of, shaken, two_views

from farpoint._kernels.halves import MOST, disagreement
from farpoint._kernels.linear import draw_index
from farpoint._kernels.pairs import LANES, PANEL, packed_length, take_pairs
from farpoint._kernels.pose import PackedMatches, Pose
from farpoint._kernels.refinement import refine_pose
from farpoint.geometry import so3, sphere

MIXTURE = np.array([1.0, 0.02, 0.02, 0.02])
SPREAD = 500.0
DEALS = np.int64(8)


def generator() -> np.ndarray:
    return np.zeros(1, np.uint64)


def fitted(seed: int, matches: int, sigma: np.ndarray | float = 1.0) -> tuple[PackedMatches, Pose]:
    """Matches with the noise of their factors, times ``sigma``, and the likeliest pose."""
    view = shaken(two_views(seed, matches), seed, sigma)
    given, pose = matches_of(view, SPREAD, gives_way=True), pose_of(view.R, view.t, MIXTURE)
    refine_pose(given, 1e-6, 30, pose)
    return given, pose


def covariance_of(pose: Pose) -> np.ndarray:
    return np.linalg.inv(pose.normal[:5, :5])


def apart(one: Pose, other: Pose, pose: Pose) -> np.ndarray:
    turn = so3.log(one.R @ other.R.T)
    return np.concatenate([turn, sphere.tangent_basis(pose.t).T @ (one.t - other.t)])


def refined(matches: PackedMatches, rows: np.ndarray, start: Pose) -> Pose:
    pairs = np.empty(packed_length(len(rows)) // LANES * PANEL)
    take_pairs(matches.pairs, rows, pairs)
    half = matches._replace(pairs=pairs, prior=packed(matches.prior[rows]), total=len(rows))
    pose = pose_of(start.R, start.t, start.mixture)
    refine_pose(half, 1e-2, 10, pose)
    return pose


def test_it_is_the_mean_over_halves_of_what_they_differ_by():
    matches, pose = fitted(1, 45)
    matches.prior[:45] = np.random.default_rng(2).uniform(0.5, 2.0, 45)
    covariance, state, rows = covariance_of(pose), generator(), np.arange(45)
    squares = []
    for _ in range(DEALS):
        for i in range(45):  # Fisher and Yates
            j = i + draw_index(state, 45 - i)
            rows[[i, j]] = rows[[j, i]]
        difference = apart(*(refined(matches, half, pose) for half in (rows[:22], rows[22:])), pose)
        squares.append(difference @ np.linalg.solve(4.0 * covariance, difference) / 5.0)
    shown = disagreement(matches, pose, covariance, DEALS, generator())
    assert shown == pytest.approx(np.mean(squares), rel=1e-4)
    assert disagreement(matches, pose, covariance, DEALS, generator()) == shown


def mean_disagreement(apart_rad: float) -> float:
    """Where half of 60 matches ask for a motion with another rotation."""
    shown = []
    for seed in range(12):
        view = shaken(two_views(seed, 60), seed)
        axis = sphere.normalize(np.random.default_rng(seed).normal(size=3))
        view.rays1[:30] = view.rays1[:30] @ so3.exp(apart_rad * axis).T
        matches = matches_of(view, SPREAD, gives_way=True)
        pose = pose_of(view.R, view.t, MIXTURE)
        refine_pose(matches, 1e-6, 30, pose)
        shown.append(disagreement(matches, pose, covariance_of(pose), DEALS, generator()))
    return float(np.mean(shown))


def test_halves_disagree_where_matches_ask_for_two_motions():
    # 1.3 and 5: halves of 30 matches are curved, and which motion they follow is decided by few.
    assert 0.9 < mean_disagreement(0.0) < 1.6
    assert mean_disagreement(0.06) > 3.0


def test_a_covariance_that_is_too_small_shows():
    matches, pose = fitted(3, 60)
    covariance = covariance_of(pose)
    shown = disagreement(matches, pose, covariance, DEALS, generator())
    assert disagreement(matches, pose, 0.25 * covariance, DEALS, generator()) == pytest.approx(
        4.0 * shown
    )
    assert disagreement(matches, pose, 1e-9 * covariance, DEALS, generator()) == MOST
    assert disagreement(matches, pose, -covariance, DEALS, generator()) == 1.0
