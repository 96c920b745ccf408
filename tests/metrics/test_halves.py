"""The split-half test: it must pass honest estimators and catch the others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_pose import STATS

from farpoint.errors import InputError
from farpoint.geometry import so3, sphere
from farpoint.metrics import (
    consistency_ratio,
    evaluate_halves,
    image_cells,
    pose_difference,
    split_half,
)
from farpoint.pose import PoseStatus, RelativePose

TRUE_R = so3.exp([0.1, -0.2, 0.05])
TRUE_DIRECTION = sphere.normalize(np.array([0.3, -0.1, 1.0]))
MIXING = np.array(
    [
        [2e-3, 0.0, 0.0, 0.0, 0.0],
        [1e-3, 1e-3, 0.0, 0.0, 0.0],
        [0.0, 1e-3, 3e-3, 0.0, 0.0],
        [1e-2, 0.0, 2e-2, 3e-2, 0.0],
        [0.0, 2e-2, 0.0, 1e-2, 4e-2],
    ]
)
"""Square root of the covariance that one match gives: rotation and direction correlated."""


def pose_from(error: np.ndarray, covariance: np.ndarray, turn: float = 0.0) -> RelativePose:
    """An estimate with this error; its tangent basis turned by an angle, as no two need agree."""
    basis = sphere.tangent_basis(TRUE_DIRECTION)
    direction = sphere.retract(TRUE_DIRECTION, basis, -error[3:])
    c, s = np.cos(turn), np.sin(turn)
    own_basis = sphere.tangent_basis(direction) @ np.array([[c, -s], [s, c]])
    carry = np.eye(5)
    carry[3:, 3:] = own_basis.T @ basis
    return RelativePose(
        status=PoseStatus.OK,
        reason="simulated",
        rotation_cam1_from_cam0=so3.exp(-error[:3]) @ TRUE_R,
        rotation_covariance=covariance[:3, :3],
        direction_cam1_from_cam0=direction,
        direction_basis=own_basis,
        covariance=carry @ covariance @ carry.T,
        labels=np.empty(0, np.uint8),
        noise_px=None,
        stats=STATS,
    )


def mean_estimator(sigma_factor: float):
    """The mean of the matches' own errors, with its covariance times a factor squared."""

    def estimate(errors: np.ndarray, weights: np.ndarray) -> RelativePose:
        assert len(errors) == len(weights)
        covariance = MIXING @ MIXING.T / len(errors)
        turn = float(np.sum(weights))
        return pose_from(errors.mean(axis=0), sigma_factor**2 * covariance, turn)

    return estimate


def halves_of(sigma_factor: float, pairs: int = 400):
    rng = np.random.default_rng(11)
    return [
        split_half(
            (rng.normal(size=(100, 5)) @ MIXING.T, rng.normal(size=100)),
            mean_estimator(sigma_factor),
            seed=k,
        )
        for k in range(pairs)
    ]


def test_an_honest_estimator_passes():
    found = consistency_ratio(halves_of(1.0))
    assert (found.count, found.dof) == (400, 2000)
    assert found.low < found.ratio < found.high
    assert (found.low, found.high) == pytest.approx((0.94, 1.06), abs=0.01)


@pytest.mark.parametrize("sigma_factor", [0.9, 1.1])
def test_ten_per_cent_of_sigma_is_noticed(sigma_factor: float):
    found = consistency_ratio(halves_of(sigma_factor))
    assert found.ratio == pytest.approx(sigma_factor**-2, rel=0.06)
    assert not found.low < found.ratio < found.high


@pytest.mark.parametrize("sigma_factor", [0.9, 1.0, 1.1])
def test_the_figures_of_a_run_tell_rotation_and_direction_apart(sigma_factor: float):
    found = evaluate_halves(halves_of(sigma_factor))
    assert (found.pairs, found.compared, found.compared_in_rotation) == (400, 400, 0)
    assert found.ratio.ratio == pytest.approx(found.pose.mean_nees / 5.0)
    for kind in (found.rotation, found.direction, found.pose):
        assert kind.sigma_over_error == pytest.approx(sigma_factor, abs=0.08)
        assert (kind.nees_low < kind.mean_nees < kind.nees_high) == (sigma_factor == 1.0)


def test_halves_are_disjoint_complete_and_follow_the_seed():
    seen: list[np.ndarray] = []

    def estimate(rows: np.ndarray) -> RelativePose:
        seen.append(rows)
        return pose_from(np.zeros(5), MIXING @ MIXING.T)

    split_half((np.arange(7),), estimate, seed=1)
    split_half((np.arange(7),), estimate, seed=1)
    split_half((np.arange(7),), estimate, seed=2)
    assert sorted(np.concatenate(seen[:2])) == list(range(7))
    assert [len(half) for half in seen[:2]] == [4, 3]
    np.testing.assert_array_equal(seen[0], seen[2])
    assert not np.array_equal(seen[0], seen[4])


def test_groups_stay_together_and_fill_the_halves_evenly():
    groups = np.repeat([5, 3, 9, 4, 8, 1], [1, 2, 3, 4, 5, 6])
    seen: list[np.ndarray] = []

    def estimate(rows: np.ndarray) -> RelativePose:
        seen.append(rows)
        return pose_from(np.zeros(5), MIXING @ MIXING.T)

    for seed in range(5):
        split_half((np.arange(21),), estimate, seed=seed, groups=groups)
    for first, second in zip(seen[::2], seen[1::2], strict=True):
        assert sorted([*first, *second]) == list(range(21))
        assert not set(groups[first]) & set(groups[second])
        assert abs(len(first) - len(second)) <= 6
    assert len({len(first) for first in seen[::2]}) > 1


def test_an_error_that_neighbours_share_shows_where_neighbours_stay_together():
    """Ten matches a cell, a third of their variance in common: 1 + 9/3 times what is claimed."""
    rng = np.random.default_rng(12)
    cells = np.repeat(np.arange(10), 10)
    random, together = [], []
    for seed in range(300):
        shared, own = rng.normal(size=(10, 5))[cells], rng.normal(size=(100, 5))
        errors = (np.sqrt(1.0 / 3.0) * shared + np.sqrt(2.0 / 3.0) * own) @ MIXING.T
        matches = errors, np.zeros(100)
        random.append(split_half(matches, mean_estimator(1.0), seed=seed))
        together.append(split_half(matches, mean_estimator(1.0), seed=seed, groups=cells))
    assert consistency_ratio(together).ratio == pytest.approx(4.0, rel=0.1)
    # What two matches of a cell share cancels where they are dealt to different halves.
    assert consistency_ratio(random).ratio == pytest.approx(1.0, rel=0.1)


def test_cells_are_squares_of_the_image():
    points = np.array([[0.0, 0.0], [63.9, 63.9], [64.0, 0.0], [0.0, 64.0], [-0.1, 0.0]])
    cells = image_cells(points, 64.0)
    assert cells[0] == cells[1]
    assert len(set(cells)) == 4
    with pytest.raises(InputError, match=r"^cell_px: expected a positive width, got 0"):
        image_cells(points, 0.0)


def test_only_what_both_know_is_compared():
    C = MIXING @ MIXING.T
    full = pose_from(np.full(5, 1e-3), C)
    turned = replace(
        pose_from(np.zeros(5), C),
        status=PoseStatus.ROTATION_ONLY,
        direction_cam1_from_cam0=None,
        direction_basis=None,
        covariance=None,
    )
    lost = replace(
        turned, status=PoseStatus.FAILED, rotation_cam1_from_cam0=None, rotation_covariance=None
    )
    rotation = pose_difference(full, turned)
    assert rotation.statuses == (PoseStatus.OK, PoseStatus.ROTATION_ONLY)
    assert rotation.dof == 3
    expected = np.full(3, 1e-3) @ np.linalg.solve(2.0 * C[:3, :3], np.full(3, 1e-3))
    assert rotation.nees == pytest.approx(expected, rel=1e-4)
    nothing = pose_difference(full, lost)
    assert (nothing.dof, nothing.nees) == (0, 0.0)
    ratio = consistency_ratio([rotation, nothing])
    assert (ratio.count, ratio.dof) == (1, 3)
    assert np.isnan(consistency_ratio([nothing]).ratio)
    figures = evaluate_halves([rotation, nothing])
    assert (figures.pairs, figures.compared, figures.compared_in_rotation) == (2, 0, 1)
    assert (figures.rotation.count, figures.direction.count, figures.pose.count) == (1, 0, 0)
    assert figures.rotation.mean_nees == rotation.nees


@pytest.mark.parametrize("turn", [0.0, 0.5, 2.0])
def test_tangent_bases_need_not_agree(turn: float):
    C = MIXING @ MIXING.T
    error = np.array([1e-4, -2e-4, 1e-4, 3e-3, -2e-3])
    difference = pose_difference(pose_from(np.zeros(5), C, 0.3), pose_from(error, C, turn))
    assert difference.dof == 5
    assert difference.nees == pytest.approx(error @ np.linalg.solve(2.0 * C, error), rel=1e-2)


@pytest.mark.parametrize("apart_deg", [180.0, 90.01, 89.999, 89.5])
def test_directions_at_a_right_angle_and_beyond_are_infinitely_apart(apart_deg: float):
    C = MIXING @ MIXING.T
    pose = pose_from(np.zeros(5), C)
    turn, across = np.radians(apart_deg), pose.direction_basis[:, 0]
    other = np.cos(turn) * TRUE_DIRECTION + np.sin(turn) * across
    basis = np.column_stack(
        [across * np.cos(turn) - TRUE_DIRECTION * np.sin(turn), pose.direction_basis[:, 1]]
    )
    flipped = replace(pose, direction_cam1_from_cam0=other, direction_basis=basis)
    opposed, alike = pose_difference(pose, flipped), pose_difference(pose, pose)
    assert opposed.nees == np.inf
    found = evaluate_halves([opposed, alike, alike])
    assert (found.compared, found.ratio.count, found.ratio.opposed) == (3, 2, 1)
    assert (found.ratio.dof, found.ratio.ratio) == (10, pytest.approx(0.0, abs=1e-20))
    assert found.pose.coverage95.share == pytest.approx(2.0 / 3.0)


def test_arrays_of_different_length_are_refused():
    with pytest.raises(InputError, match=r"^matches: expected arrays of one length, got \[3, 4\]"):
        split_half((np.zeros(3), np.zeros(4)), mean_estimator(1.0), seed=0)
    with pytest.raises(InputError, match=r"^groups: expected shape \(3,\), got \(4,\)"):
        split_half((np.zeros(3),), mean_estimator(1.0), seed=0, groups=np.zeros(4))
