"""Second motion of a plane, against a reference in plain NumPy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from kernels_kit import View, matches_of, packed, pose_of, shaken, shares_of, two_views

from farpoint._kernels import (
    likelihood,
    mixture,
    parallax_prior,
    plane,
    refinement,
)
from farpoint._kernels.compile import kernel
from farpoint._kernels.constants import (
    CHEIRALITY_SIGMA,
    CHEIRALITY_WEIGHT,
    COARSE_TOLERANCE,
    EM_ROUNDS,
    LONG_TAIL,
    MAX_SEARCHED,
    OFF_PLANE_MATCHES,
    OFF_PLANE_PRIOR_MATCHES,
    PLANAR_MARGIN,
    RELIEF_PRIOR_MATCHES,
)
from farpoint._kernels.pose import LinearisationPoint, Pose
from farpoint.geometry import so3, sphere

MIXTURE, HALF_WIDTH = np.array([1.2, 0.02, 0.01, 0.1]), 600.0
# Median of the sum of the squares of two normal errors.
MEDIAN = 2.0 * np.log(2.0)


@kernel
def median(values: np.ndarray) -> float:
    """Upper median, by the bisection of the kernels."""
    return parallax_prior.kth_largest(values, (values.size + 1) // 2)


def wall(
    count: int,
    off: int = 0,
    relief: float = 0.0,
    outliers: int = 0,
    direction=(1.0, 0.3, -0.4),
    shape: float = 1.0,
) -> View:
    """A plane 4 m away and a translation of 0.1 m: some points in front, others with relief.

    The last matches are outliers. The noise has ``shape`` times the sigma along one of its axes.
    """
    rng = np.random.default_rng(count)
    rays0 = sphere.normalize(np.c_[rng.uniform(-0.5, 0.5, (count, 2)), np.ones(count)])
    nearness = rays0 @ (np.array([0.3, -0.2, 1.0]) / 4.0) * rng.normal(1.0, relief, count)
    nearness[:off] *= 1.4
    R, t = so3.exp(np.array([0.04, -0.03, 0.05])), sphere.normalize(np.array(direction))
    rays1 = rays0 @ R.T + 0.1 * nearness[:, None] * t
    rays1[count - outliers :] += rng.normal(0.0, 5e-3, (outliers, 3))
    rays1 = sphere.normalize(rays1)
    axes = np.array([1e-4, 1e-4 * shape])
    noise = (axes * sphere.tangent_basis(rays) for rays in (rays0, rays1))
    return shaken(View(rays0, rays1, *noise, R, t), 1)


class Other(NamedTuple):
    is_secondary_mode: bool
    log_ratio: float
    R: np.ndarray
    t: np.ndarray


def other_of(view: View, prior: np.ndarray | None = None, is_given: bool = False) -> Other:
    pose = Pose(view.R, view.t, MIXTURE, np.empty((6, 6)), np.empty(1))
    other = pose_of(*(np.full_like(array, np.nan) for array in pose[:3]))
    matches = matches_of(view, HALF_WIDTH, prior, soft_cheirality=False)
    found = plane.other_motion(matches, pose, other, is_given)
    return Other(*found, other.R, other.t)


def evaluate(view: View, R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Parallax of each match for unit noise, and its inlier probability."""
    computed, prior = np.empty((3, len(packed(np.ones(view.size))))), packed(np.ones(view.size))
    likelihood.evaluate_residuals(
        LinearisationPoint(view.pairs, prior, R, t, MIXTURE, HALF_WIDTH, LONG_TAIL),
        *computed,
    )
    return computed[1, : view.size], computed[2, : view.size]


def off_plane(view: View, R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Offsets of the later rays (N, 3) from the prediction by the plane, over the noise sigma.

    By robust least squares of the plane in the tangent planes of the rays.
    """
    inlier = evaluate(view, R, t)[1] > 0.5
    axes = sphere.tangent_basis(view.rays1)
    still = np.einsum("nik,ni->nk", axes, view.rays0 @ R.T)
    moved = np.einsum("nik,i->nk", axes, t)[:, :, None] * view.rays0[:, None, :]
    traces = np.sum(view.noise0**2, axis=(1, 2)) + np.sum(view.noise1**2, axis=(1, 2))
    precision = 1.0 / (0.5 * traces * MIXTURE[0])
    weight, off = inlier.astype(float), still
    for _ in range(EM_ROUNDS):
        M = np.einsum("n,nki,nkj->ij", weight * precision, moved, moved)
        v = np.einsum("n,nki,nk->i", weight * precision, moved, still)
        n = -np.linalg.solve(M + (1e-9 * np.trace(M) + 1e-300) * np.eye(3), v)
        off = (still + moved @ n) / np.sqrt(MIXTURE[0])
        square = np.sum(off**2, axis=1) / (0.5 * traces)
        typical = max(median(square[inlier]) / MEDIAN, 1.0) if inlier.any() else 1.0
        weight = inlier / (1.0 + square / (9.0 * typical)) ** 2
    return np.einsum("nik,nk->ni", axes, off)


class Relief(NamedTuple):
    likelihood: float
    across: float
    along: float


def parts_of(
    view: View, off: np.ndarray, R: np.ndarray, t: np.ndarray, is_given: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Squared offsets for unit noise: total, and across the epipolar line of t."""
    axes = sphere.tangent_basis(view.rays1)
    factors = (np.einsum("nik,ij,njm->nkm", axes, R, view.noise0), axes.mT @ view.noise1)
    covariance = sum(each @ each.mT for each in factors)
    if is_given:
        traces = np.sum(view.noise0**2, axis=(1, 2)) + np.sum(view.noise1**2, axis=(1, 2))
        covariance = 0.5 * traces[:, None, None] * np.eye(2)
    away = np.einsum("nik,ni->nk", axes, off)
    aside = np.einsum("nik,ni->nk", axes, np.cross(t, view.rays1))
    across = np.sum(away * aside, axis=1) ** 2
    across /= np.einsum("nk,nkm,nm->n", aside, covariance, aside)
    return np.einsum("nk,nkm,nm->n", away, np.linalg.inv(covariance), away), across


def likelihood_by(
    view: View, squares: tuple[np.ndarray, np.ndarray], R: np.ndarray, t: np.ndarray
) -> Relief:
    """Log likelihood of the offsets, with noise across the lines and relief along them, by EM."""
    whole, c2 = squares
    a2 = whole - c2
    shift = evaluate(view, R, t)[0] / np.sqrt(MIXTURE[0])
    variance, tail_share = 8.0 ** np.arange(4.0)[:, None], MIXTURE[2]
    shares = shares_of(tail_share)
    anywhere, near, _ = mixture.clutter_of(MIXTURE, HALF_WIDTH)
    clutter = anywhere + near
    peak = 2.0 * HALF_WIDTH / np.sqrt(2.0 * np.pi * MIXTURE[0])
    across = along = 1.0
    found, off = -np.inf, OFF_PLANE_MATCHES / OFF_PLANE_PRIOR_MATCHES
    for _ in range(EM_ROUNDS):
        beyond = np.minimum(shift / np.sqrt(across) + CHEIRALITY_SIGMA, 0.0)
        penalty = CHEIRALITY_WEIGHT * beyond**2
        exponent = -0.5 * (c2 / across + penalty) / variance
        kinds = shares * np.exp(exponent) / np.sqrt(variance * across)
        about = (1.0 - off) * peak * np.exp(-0.5 * a2 / along) / np.sqrt(along)
        density = kinds.sum(axis=0) * (off + about) + clutter
        before, found = found, np.log(density).sum()
        if abs(found - before) < COARSE_TOLERANCE:
            break
        w = kinds[0] * about / density
        sums = w.sum(), np.sum(w * c2) + RELIEF_PRIOR_MATCHES, np.sum(w * a2)
        across, along = sums[1] / (sums[0] + RELIEF_PRIOR_MATCHES), sums[2] / max(sums[0], 1.0)
        if along < across:
            across = along = (sums[1] + sums[2]) / (2.0 * sums[0] + RELIEF_PRIOR_MATCHES)
        lines = kinds.sum(axis=0) / density
        off = (OFF_PLANE_MATCHES + off * lines.sum()) / (
            OFF_PLANE_PRIOR_MATCHES + np.sum((off + about) * lines)
        )
    return Relief(found, across, along)


@pytest.mark.parametrize(
    ("count", "off", "relief", "outliers", "is_rough", "shape", "is_given"),
    [
        (40, 1, 0.0, 0, False, 1.0, False),
        (41, 0, 0.015, 0, True, 1.0, False),
        (40, 0, 0.02, 0, True, 1.0, True),
        (9, 2, 0.0, 0, False, 1.0, False),
        (40, 0, 0.02, 3, True, 1.0, False),
        (320, 1, 0.0, 0, False, 1.0, False),
        (40, 0, 0.02, 0, True, 2.0, False),
        (40, 0, 0.02, 0, True, 2.0, True),
    ],
)
def test_the_evidence_for_the_first_motion_is_relief_along_its_lines(
    count, off, relief, outliers, is_rough, shape, is_given
):
    view = wall(count, off, relief, outliers, shape=shape)
    other = other_of(view, is_given=is_given)
    assert other.is_secondary_mode
    expected, motions = 0.0, [(view.R, view.t), (other.R, other.t)]
    for planar in motions:
        away = off_plane(view, *planar)
        first, second = (
            likelihood_by(view, parts_of(view, away, planar[0], t, is_given), R, t)
            for R, t in motions
        )
        expected += 0.5 * (first.likelihood - second.likelihood)
        if planar is motions[0]:  # else nothing is tested
            assert (first.along > 1.5 * first.across) == is_rough
    assert abs(expected) > 1.0
    assert other.log_ratio == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("shape", [1.0, 2.0, 0.5])
def test_a_plane_without_relief_is_no_evidence(shape):
    # The likelihoods differ by 3, because each motion ignores the noise along its own lines.
    assert abs(other_of(wall(40, shape=shape)).log_ratio) < 0.5


def test_one_match_off_the_plane_is_little_evidence_and_the_next_one_more():
    # One or two outliers on their lines are consistent with any motion: a fixed share of 0.1 off
    # the plane would give 6 for each.
    log_ratio = [other_of(wall(320, off)).log_ratio for off in (0, 1, 2, 4, 6)]
    evaluated = np.diff(log_ratio) / (1, 1, 2, 2)
    assert np.all(evaluated[:2] > 1.0)
    assert np.all(evaluated[:2] < 4.0)
    assert np.all(np.diff(evaluated[1:]) > 0.0)
    assert evaluated[-1] > 1.25 * evaluated[0]


def test_the_other_motion_is_a_minimum_of_its_own_and_nearly_as_low():
    view, costs = wall(60), []
    other = other_of(view)
    assert sphere.angle_between(other.t, view.t) > 0.5
    for start in ((view.R, view.t), (other.R, other.t)):
        pose = pose_of(*start, MIXTURE)
        refinement.refine_pose(matches_of(view, HALF_WIDTH, soft_cheirality=False), 1e-6, 50, pose)
        costs.append(pose.cost[0])
        np.testing.assert_allclose(pose.t, start[1], rtol=0.0, atol=0.05)
    near = PLANAR_MARGIN * np.sqrt(60.0 / MAX_SEARCHED)
    assert abs(costs[1] - costs[0]) < near


def test_the_given_motion_stays_unchanged():
    view, noise = wall(40, off=2), MIXTURE.copy()
    R, t = view.R.copy(), view.t.copy()
    other_of(view)
    for before, after in ((R, view.R), (t, view.t), (noise, MIXTURE)):
        np.testing.assert_array_equal(before, after)


def test_points_at_any_distance_allow_no_other_motion():
    assert not other_of(shaken(two_views(0, 60, noise_rad=1e-4), 1)).is_secondary_mode


def test_a_wall_straight_ahead_allows_one_motion():
    normal = sphere.normalize(np.array([0.3, -0.2, 1.0]))
    R = so3.exp(np.array([0.04, -0.03, 0.05]))
    assert not other_of(wall(60, direction=R @ normal)).is_secondary_mode


@pytest.mark.parametrize("degrees", [2.0, 5.0, 9.0])
def test_of_a_wall_nearly_straight_ahead_the_other_motion_is_as_near(degrees):
    normal = sphere.normalize(np.array([0.3, -0.2, 1.0]))
    R, aside = so3.exp(np.array([0.04, -0.03, 0.05])), so3.exp(np.radians([0.0, degrees, 0.0]))
    other = other_of(wall(60, direction=R @ aside @ normal))
    assert other.is_secondary_mode
    assert abs(other.log_ratio) < 1.0
    # Translation and normal exchange their places.
    np.testing.assert_allclose(other.t, R @ normal, atol=0.05)


def test_without_inliers_there_is_no_evidence():
    other = other_of(wall(40, off=1), prior=1e-12 * packed(np.ones(40)))
    assert other.is_secondary_mode
    assert other.log_ratio == pytest.approx(0.0, abs=1e-6)
