"""Split-half ratio, against a reference in NumPy."""

from __future__ import annotations

import os

import numpy as np
import pytest
from kernels_kit import View, matches_of, packed, pose_of, shaken, two_views

from farpoint._kernels.compile import kernel
from farpoint._kernels.constants import LANES, MAX_SPLIT_RATIO, MIN_SIGNAL_NEARBY, PANEL
from farpoint._kernels.covariance import MEASURED_FLOW, covariance_here
from farpoint._kernels.image_parts import split_parts
from farpoint._kernels.pairs import packed_length, take_pairs
from farpoint._kernels.pose import LinearisationPoint, PackedMatches, Pose
from farpoint._kernels.refinement import refine_pose
from farpoint._kernels.split_halves import pose_difference_ratio
from farpoint.geometry import so3, sphere

MIXTURE = np.array([1.0, 0.02, 0.02, 0.02])
HALF_WIDTH = 500.0
SPLITS = np.int64(8)
INLIERS = 40.0


def generator() -> np.ndarray:
    return np.zeros(1, np.uint64)


def fitted(seed: int, matches: int, times: int = 1) -> tuple[PackedMatches, Pose]:
    """Matches with the noise of their factors, each ``times`` times, and the likeliest pose."""
    view = shaken(two_views(seed, matches), seed)
    repeated = [np.repeat(array, times, axis=0) for array in view[:4]]
    view = View(*repeated, view.R, view.t)
    given, pose = (
        matches_of(view, HALF_WIDTH, soft_cheirality=True),
        pose_of(view.R, view.t, MIXTURE),
    )
    refine_pose(given, 1e-6, 30, pose)
    return given, pose


@kernel
def _here(point: LinearisationPoint, inliers: float, out: np.ndarray) -> bool:
    return covariance_here(point, inliers, MEASURED_FLOW, MIN_SIGNAL_NEARBY, out)


def expected_of(matches: PackedMatches, pose: Pose) -> np.ndarray:
    covariance = np.empty((5, 5))
    point = LinearisationPoint(
        matches.pairs,
        matches.prior,
        pose.R,
        pose.t,
        pose.mixture,
        matches.outlier_half_width,
        matches.long_tail,
    )
    assert _here(point, INLIERS, covariance)
    return covariance


def each_by_itself(count: int) -> np.ndarray:
    return np.arange(count)


def computed(matches: PackedMatches, pose: Pose, part: np.ndarray) -> float:
    return pose_difference_ratio(matches, pose, INLIERS, False, SPLITS, part, generator())


def apart(one: Pose, other: Pose, pose: Pose) -> np.ndarray:
    rotation = so3.log(one.R @ other.R.T)
    return np.concatenate([rotation, sphere.tangent_basis(pose.t).T @ (one.t - other.t)])


def searched_pairs(matches: PackedMatches, rows: np.ndarray) -> PackedMatches:
    pairs = np.empty(packed_length(len(rows)) // LANES * PANEL)
    take_pairs(matches.pairs, rows, pairs)
    return matches._replace(pairs=pairs, prior=packed(matches.prior[rows]), total=len(rows))


def refined(matches: PackedMatches, start: Pose) -> Pose:
    pose = pose_of(start.R, start.t, start.mixture)
    refine_pose(matches, 1e-2, 10, pose)
    return pose


@pytest.mark.parametrize("parts", [45, 12])
def test_it_is_the_mean_over_halves_of_what_they_differ_by(parts):
    matches, pose = fitted(1, 45)
    rng = np.random.default_rng(2)
    matches.prior[:45] = rng.uniform(0.5, 1.0, 45)
    part, state = rng.permutation(np.arange(45) % parts), generator()
    squares = []
    for _ in range(SPLITS):
        half = np.empty(45, np.int64)
        split_parts(part, state, half)
        halves = [searched_pairs(matches, np.flatnonzero(half == k)) for k in (0, 1)]
        covariance = sum(expected_of(half, pose) for half in halves)
        difference = apart(*(refined(half, pose) for half in halves), pose)
        squares.append(difference @ np.linalg.solve(covariance, difference) / 5.0)
    shown = computed(matches, pose, part)
    assert shown == pytest.approx(np.mean(squares), rel=1e-4)
    assert computed(matches, pose, part) == shown


def mean_disagreement(apart_rad: float) -> float:
    """Mean ratio where half of 60 matches have a motion with another rotation."""
    shown = []
    for seed in range(12):
        view = shaken(two_views(seed, 60), seed)
        axis = sphere.normalize(np.random.default_rng(seed).normal(size=3))
        view.rays1[:30] = view.rays1[:30] @ so3.exp(apart_rad * axis).T
        matches = matches_of(view, HALF_WIDTH, soft_cheirality=True)
        pose = pose_of(view.R, view.t, MIXTURE)
        refine_pose(matches, 1e-6, 30, pose)
        shown.append(computed(matches, pose, each_by_itself(60)))
    return float(np.mean(shown))


def test_the_ratio_is_large_where_matches_have_two_motions():
    # 0.8 and 1.5: a few matches decide which motion a half follows.
    one_motion, two_motions = mean_disagreement(0.0), mean_disagreement(0.06)
    assert 0.7 < one_motion < 0.95
    assert two_motions > 1.6 * one_motion


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="takes a minute")
def test_common_errors_of_a_patch_raise_the_ratio_if_it_stays_in_one_half():
    shown = []
    for seed in range(30):
        matches, pose = fitted(seed, 60, times=5)
        part = np.arange(300) // 5
        shown.append([computed(matches, pose, p) for p in (part, each_by_itself(300))])
    by_patch, by_match = np.mean(shown, axis=0)
    assert 4.0 < by_patch < 6.0
    assert by_match < 1.5


def test_noise_that_is_larger_than_was_thought_shows():
    matches, pose = fitted(3, 200)
    shown = computed(matches, pose, each_by_itself(200))
    too_confident = pose._replace(mixture=pose.mixture * [0.25, 1.0, 1.0, 1.0])
    # Less than 4 times as large: the covariance contains the scatter of the residuals, too.
    assert computed(matches, too_confident, each_by_itself(200)) > 1.5 * shown


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="takes 11 s")
def test_the_ratio_of_one_split_is_bounded():
    """Two motions of 800 matches each, three sigma apart, and one motion in each half."""
    view = shaken(two_views(5, 1600), 5)
    view.rays1[800:] = view.rays1[800:] @ so3.exp(np.array([0.0, 0.003, 0.0])).T
    matches, pose = (
        matches_of(view, HALF_WIDTH, soft_cheirality=True),
        pose_of(view.R, view.t, MIXTURE),
    )
    refine_pose(matches, 1e-6, 30, pose)
    assert computed(matches, pose, np.arange(1600) // 800) == MAX_SPLIT_RATIO
    assert computed(matches, pose, each_by_itself(1600)) < 2.0


def test_halves_that_fix_no_motion_count_as_expected():
    view, pose = two_views(5, 60), pose_of(*two_views(5, 60)[4:], MIXTURE)
    point = [np.tile(rays[:1], (60, 1)) for rays in view[:2]]
    matches = matches_of(
        view._replace(rays0=point[0], rays1=point[1]), HALF_WIDTH, soft_cheirality=True
    )
    assert computed(matches, pose, each_by_itself(60)) == 1.0
    # All in one part: there is no second half.
    assert (
        computed(matches_of(view, HALF_WIDTH, soft_cheirality=True), pose, np.zeros(60, np.int64))
        == 1.0
    )
