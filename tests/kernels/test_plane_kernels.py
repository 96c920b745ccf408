"""The other motion that a plane allows, beside what plain NumPy makes of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from kernels_kit import View, matches_of, packed, pose_of, shaken, two_views

from farpoint._kernels import likelihood, mixture, plane
from farpoint._kernels.pose import Pose, Seen
from farpoint.geometry import so3, sphere

MIXTURE, SPREAD = np.array([1.2, 0.02, 0.01]), 600.0
# Median of the sum of the squares of two normal errors.
MEDIAN = 2.0 * np.log(2.0)


def wall(
    count: int, off: int = 0, relief: float = 0.0, wrong: int = 0, towards=(1.0, 0.3, -0.4)
) -> View:
    """A plane 4 m away seen from 0.1 m on: some points well before it, the others by ``relief``.

    The last matches are wrong.
    """
    rng = np.random.default_rng(count)
    rays0 = sphere.normalize(np.c_[rng.uniform(-0.5, 0.5, (count, 2)), np.ones(count)])
    nearness = rays0 @ (np.array([0.3, -0.2, 1.0]) / 4.0) * rng.normal(1.0, relief, count)
    nearness[:off] *= 1.4
    R, t = so3.exp(np.array([0.04, -0.03, 0.05])), sphere.normalize(np.array(towards))
    rays1 = rays0 @ R.T + 0.1 * nearness[:, None] * t
    rays1[count - wrong :] += rng.normal(0.0, 5e-3, (wrong, 3))
    rays1 = sphere.normalize(rays1)
    noise = (1e-4 * sphere.tangent_basis(rays) for rays in (rays0, rays1))
    return shaken(View(rays0, rays1, *noise, R, t), 1)


class Other(NamedTuple):
    is_rival: bool
    against: float
    R: np.ndarray
    t: np.ndarray


def other_of(view: View, prior: np.ndarray | None = None) -> Other:
    pose = Pose(view.R, view.t, MIXTURE, np.empty((6, 6)), np.empty(1))
    other = pose_of(*(np.full_like(array, np.nan) for array in pose[:3]))
    found = plane.other_motion(matches_of(view, SPREAD, prior, gives_way=False), pose, other)
    return Other(*found, other.R, other.t)


def right_of(view: View, R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Probability of each match to be right."""
    told, prior = np.empty((3, len(packed(np.ones(view.size))))), packed(np.ones(view.size))
    clutter = mixture.clutter_density(MIXTURE[0], MIXTURE[1], SPREAD)
    likelihood.explain(Seen(view.pairs, prior, R, t, MIXTURE, clutter), *told)
    return told[2, : view.size]


def squares_from_plane(view: View, right: np.ndarray) -> np.ndarray:
    """By robust least squares of the plane in the tangent planes of the later rays."""
    across = sphere.tangent_basis(view.rays1)
    still = np.einsum("nik,ni->nk", across, view.rays0 @ view.R.T)
    moved = np.einsum("nik,i->nk", across, view.t)[:, :, None] * view.rays0[:, None, :]
    traces = np.sum(view.noise0**2, axis=(1, 2)) + np.sum(view.noise1**2, axis=(1, 2))
    precision = 1.0 / (0.5 * traces * MIXTURE[0])
    weight, square = right.astype(float), np.zeros(view.size)
    for _ in range(plane.PLANE_ROUNDS):
        M = np.einsum("n,nki,nkj->ij", weight * precision, moved, moved)
        v = np.einsum("n,nki,nk->i", weight * precision, moved, still)
        n = -np.linalg.solve(M + (1e-9 * np.trace(M) + 1e-300) * np.eye(3), v)
        square = precision * np.sum((still + moved @ n) ** 2, axis=1)
        typical = max(np.median(square[right]) / MEDIAN, 1.0) if right.any() else 1.0
        weight = right / (1.0 + square / (9.0 * typical)) ** 2
    return square


def expected_evidence(view: View, other: Other) -> tuple[float, float, int]:
    """Evidence; the weight of what matches near the plane say, and how many are off it."""
    right = right_of(view, view.R, view.t)
    gain = np.log1p(-right_of(view, other.R, other.t)) - np.log1p(-right)
    square = squares_from_plane(view, right > 0.5)
    off = square > 16.0
    near = (right > 0.5) & ~off
    excess = np.median(square[near]) / MEDIAN * (1.0 - near.sum() ** -0.5) - 1.0 if any(near) else 0
    weight = 2.0 * max(excess, 0.0) / (1.0 + 2.0 * max(excess, 0.0))
    return gain[off].sum() + weight * gain[~off].sum(), weight, off.sum()


@pytest.mark.parametrize(
    ("count", "off", "relief", "wrong", "is_rough"),
    [
        (40, 1, 0.0, 0, False),
        (41, 0, 0.015, 0, True),
        (40, 0, 0.02, 0, True),
        (8, 2, 0.0, 0, False),
        (40, 0, 0.02, 3, True),
        (320, 1, 0.0, 0, False),
    ],
)
def test_what_speaks_for_the_first_motion_is_what_is_off_the_plane(
    count, off, relief, wrong, is_rough
):
    view = wall(count, off, relief, wrong)
    other = other_of(view)
    assert other.is_rival
    expected, weight, beyond = expected_evidence(view, other)
    # Else nothing is tested.
    assert (weight > 0.02) == is_rough
    assert beyond >= off
    assert abs(expected) > 1.0
    # Of more matches, what chance makes of them grows with the root of their number.
    expected /= np.sqrt(max(count / 160.0, 1.0))
    assert other.against == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_a_bare_wall_speaks_for_neither():
    assert other_of(wall(40)).against == 0.0


def test_the_other_motion_is_a_minimum_of_its_own_and_nearly_as_low():
    view, costs = wall(60), []
    other = other_of(view)
    assert sphere.angle_between(other.t, view.t) > 0.5
    for start in ((view.R, view.t), (other.R, other.t)):
        pose = pose_of(*start, MIXTURE)
        likelihood.refine_pose(matches_of(view, SPREAD, gives_way=False), 1e-6, 50, pose)
        costs.append(pose.cost[0])
        np.testing.assert_allclose(pose.t, start[1], rtol=0.0, atol=0.05)
    assert abs(costs[1] - costs[0]) < plane.RIVAL


def test_the_motion_that_was_asked_about_stays_as_it_is():
    view, noise = wall(40, off=2), MIXTURE.copy()
    R, t = view.R.copy(), view.t.copy()
    other_of(view)
    for before, after in ((R, view.R), (t, view.t), (noise, MIXTURE)):
        np.testing.assert_array_equal(before, after)


def test_points_at_any_distance_allow_no_other_motion():
    assert not other_of(shaken(two_views(0, 60, noise_rad=1e-4), 1)).is_rival


def test_a_wall_straight_ahead_allows_one_motion():
    normal = sphere.normalize(np.array([0.3, -0.2, 1.0]))
    R = so3.exp(np.array([0.04, -0.03, 0.05]))
    assert not other_of(wall(60, towards=R @ normal)).is_rival


def test_where_no_match_is_right_nothing_speaks_for_either():
    other = other_of(wall(40, off=1), prior=1e-12 * packed(np.ones(40)))
    assert other.is_rival
    assert other.against == pytest.approx(0.0, abs=1e-6)
