"""Monte Carlo: errors at the Cramer-Rao bound, and covariances that keep their promise.

Seeded, so each figure is the same in every run; the limits are where chance would put it in one of
a thousand sets of trials, or where the estimator stands today, and each says which.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from pose_kit import estimate, point_scene, pose_error, rotation_error
from scipy.stats import chi2

from farpoint import PoseStatus, estimate_relative_pose
from farpoint.geometry import so3, sphere
from farpoint.synthetic import (
    PointSceneOptions,
    cramer_rao_bound,
    make_point_scene,
    paper_camera,
    rotation_cramer_rao_bound,
)

TRIALS = 1000


@dataclass(frozen=True)
class Cell:
    """One setting of the paper's protocol."""

    baseline_m: float
    far_share: float
    noise_px: float
    outliers: int

    def __str__(self) -> str:
        return (
            f"{100 * self.baseline_m:g}cm-far{self.far_share:g}-"
            f"{self.noise_px:.2g}px-{self.outliers}wrong"
        )


PAPER_PX = math.sqrt(0.05)
CLEAN = [
    Cell(0.02, 0.5, PAPER_PX, 0),
    Cell(0.05, 0.5, PAPER_PX, 0),
    Cell(0.20, 0.0, PAPER_PX, 0),
]
DIRTY = [Cell(0.20, 0.5, 0.5, 20), Cell(0.05, 0.0, PAPER_PX, 20)]


@dataclass(frozen=True)
class Trials:
    """What came of a cell: errors and how large they should be, a row for each OK pose."""

    observed: int
    nees: np.ndarray
    rotation_nees: np.ndarray
    bound_nees: np.ndarray
    rotation_ratio2: np.ndarray
    direction_ratio2: np.ndarray


@cache
def run(cell: Cell) -> Trials:
    rng = np.random.default_rng([2008, round(1e4 * cell.baseline_m), cell.outliers])
    rows = []
    for _ in range(TRIALS):
        step = cell.baseline_m * sphere.normalize(rng.normal(size=3))
        turn = np.radians(rng.uniform(-5.0, 5.0, 3))
        options = PointSceneOptions(
            camera=paper_camera(),
            matches=90 + cell.outliers,
            outliers=cell.outliers,
            far_share=cell.far_share,
            far_range_m=(200.0, 1000.0),
            rotation_vector_rad=tuple(turn),
            translation_m=tuple(step),
            noise_px=cell.noise_px,
        )
        scene = make_point_scene(options, seed=rng)
        pose = estimate(scene)
        if pose.status is not PoseStatus.OK:
            continue
        error = pose_error(pose, scene)
        bound = cramer_rao_bound(scene)
        # The bound is stated in the basis at the truth; the error here in that at the estimate.
        dbeta = -sphere.tangent_basis(scene.direction_cam1_from_cam0).T @ (
            pose.direction_cam1_from_cam0
        )
        at_truth = np.concatenate([error[:3], dbeta])
        rows.append(
            (
                error @ np.linalg.solve(pose.covariance, error),
                error[:3] @ np.linalg.solve(pose.rotation_covariance, error[:3]),
                at_truth @ np.linalg.solve(bound, at_truth),
                error[:3] @ error[:3] / np.trace(bound[:3, :3]),
                sphere.angle_between(pose.direction_cam1_from_cam0, scene.direction_cam1_from_cam0)
                ** 2
                / np.trace(bound[3:, 3:]),
            )
        )
    return Trials(len(rows), *np.array(rows).T)


@pytest.mark.parametrize("cell", CLEAN + DIRTY, ids=str)
def test_errors_are_at_the_cramer_rao_bound(cell):
    trials = run(cell)
    assert trials.observed >= 0.98 * TRIALS
    # Mean squares of 1000 errors scatter by 3 % (five components) to 5 % (two).
    assert np.sqrt(trials.rotation_ratio2.mean()) < 1.12
    assert np.sqrt(trials.direction_ratio2.mean()) < 1.15
    # Better than the bound is a mistake in the test, or in the bound; but for what that does not
    # know: that far points cannot retreat, which makes rotations better by up to a sixth.
    assert np.sqrt(trials.rotation_ratio2.mean()) > 0.8
    assert np.sqrt(trials.direction_ratio2.mean()) > 0.85
    # With outliers the tails are heavier: a wrong match near its epipolar line looks right.
    assert np.mean(trials.bound_nees) / 5.0 < (1.2 if cell.outliers == 0 else 1.35)


@pytest.mark.parametrize("cell", CLEAN, ids=str)
def test_sigmas_are_neither_too_small_nor_too_large(cell):
    # The mean NEES of 1000 honest errors lies within 5 +- 3 * 0.1. Sigmas 10 % too small would make
    # it 6.2, 10 % too large 4.1. It is less than 5: far points that cannot retreat tell more than
    # the bound and the covariances know, 90 matches tell the noise to a tenth, for which the
    # covariances allow.
    nees = run(cell).nees
    assert 4.5 < np.mean(nees) < 5.4
    assert np.median(nees) / chi2.ppf(0.5, 5) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("cell", DIRTY, ids=str)
def test_typical_sigmas_are_right_among_wrong_matches(cell):
    # The median, as a few wild errors of today's make the mean useless: 3 * 4.5 % of chance.
    assert np.median(run(cell).nees) / chi2.ppf(0.5, 5) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("cell", CLEAN + DIRTY, ids=str)
def test_regions_of_95_percent_hold_the_truth(cell):
    # Chance alone would keep 0.95 within 0.91 and 0.99. Today's shares are 0.88 to 0.96, the lowest
    # those of rotations among wrong matches: the limit is to rise with them.
    trials = run(cell)
    pose = np.mean(trials.nees < chi2.ppf(0.95, 5))
    rotation = np.mean(trials.rotation_nees < chi2.ppf(0.95, 3))
    least = 0.88 if cell.outliers == 0 else 0.85
    assert least <= pose <= 0.99
    assert least <= rotation <= 0.99


def test_heavy_tails_cost_little_more_than_they_must():
    # Cauchy's distribution, as key points have it: sigmas of 0.15 px over the root of chi squared
    # with one degree of freedom. Of normal noise of 0.15 px half of the information is left.
    found = []
    for seed in range(200):
        rng = np.random.default_rng([seed, 5])
        options = {
            "matches": 500,
            "outliers": 50,
            "far_share": 0.3,
            "rotation_vector_rad": tuple(np.radians(rng.uniform(-5.0, 5.0, 3))),
            "translation_m": tuple(0.2 * sphere.normalize(rng.normal(size=3))),
        }
        exact = point_scene(seed, noise_px=1e-9, **options)
        sigma = 0.15 / np.sqrt(rng.chisquare(1.0, (500, 1)))
        pixels = [p + sigma * rng.normal(size=(500, 2)) for p in (exact.points0, exact.points1)]
        error = pose_error(estimate_relative_pose(*pixels, exact.camera), exact)
        bound = 2.0 * cramer_rao_bound(point_scene(seed, noise_px=0.15, **options))
        parts = slice(0, 3), slice(3, 5)
        found.append([error[k] @ error[k] / np.trace(bound[k, k]) for k in parts])
    # Chance makes 5 % of a median of 200. Without the poorer among the poor: 1.08, 1.20.
    over = np.sqrt(np.median(found, axis=0) / [chi2.ppf(0.5, 3) / 3, chi2.ppf(0.5, 2) / 2])
    assert (over < 1.12).all()


def test_long_tails_leave_most_of_what_good_matches_tell():
    # Half of the matches are off by a tenth of a pixel, the others by 0.3 to 6 px, as many by each.
    found = []
    for seed in range(150):
        rng = np.random.default_rng(seed)
        options = {"matches": 400, "outliers": 0, "far_share": 0.3, "translation_m": (0.1, 0, 0.2)}
        exact = point_scene(seed, noise_px=1e-9, **options)
        sigma = np.full((400, 1), 0.1)
        sigma[200:, 0] = np.exp(rng.uniform(np.log(0.3), np.log(6.0), 200))
        pixels = [p + sigma * rng.normal(size=(400, 2)) for p in (exact.points0, exact.points1)]
        error = pose_error(estimate_relative_pose(*pixels, exact.camera), exact)
        bound = 2.0 * cramer_rao_bound(point_scene(seed, noise_px=0.1, **options))
        parts = slice(0, 3), slice(3, 5)
        found.append([error[k] @ error[k] / np.trace(bound[k, k]) for k in parts])
    # By the bound of the good ones alone: 1.30 and 1.22; 1.76 and 1.78 if none is poorer than
    # eight times as far off. Chance makes 6 % of a median of 150.
    over = np.sqrt(np.median(found, axis=0) / [chi2.ppf(0.5, 3) / 3, chi2.ppf(0.5, 2) / 2])
    assert (over < 1.45).all()


def test_matches_that_are_off_along_their_lines_do_not_draw_the_rotation():
    # Two fifths are off by up to 5 px to any side. Of the far ones half of these retreat, and the
    # others come nearer, which tells nothing: where those that retreat drew the pose, 0.040 deg.
    off_deg = []
    for seed in range(80):
        rng = np.random.default_rng([seed, 6])
        turn, move = rng.uniform(-0.08, 0.08, 3), 0.1 * sphere.normalize(rng.normal(size=3))
        scene = point_scene(
            seed,
            matches=300,
            outliers=0,
            far_share=0.5,
            rotation_vector_rad=tuple(turn),
            translation_m=tuple(move),
        )
        wrong = rng.uniform(size=(300, 1)) < 0.4
        points1 = scene.points1 + wrong * rng.uniform(-5.0, 5.0, (300, 2))
        pose = estimate_relative_pose(scene.points0, points1, scene.camera)
        error = rotation_error(pose, scene.rotation_cam1_from_cam0)
        off_deg.append(np.degrees(np.linalg.norm(error)))
    assert np.median(off_deg) < 0.025


@pytest.mark.parametrize("outliers", [0, 20])
def test_the_rotation_of_a_camera_that_only_turns_is_at_its_own_bound(outliers):
    nees, bound_nees = [], []
    for seed in range(120):
        rng = np.random.default_rng(seed)
        options = PointSceneOptions(
            camera=paper_camera(),
            matches=80 + outliers,
            outliers=outliers,
            rotation_vector_rad=tuple(np.radians(rng.uniform(-5.0, 5.0, 3))),
            translation_m=(0.0, 0.0, 0.0),
        )
        scene = make_point_scene(options, seed=rng)
        pose = estimate(scene)
        if pose.status is not PoseStatus.ROTATION_ONLY:
            continue
        error = rotation_error(pose, scene.rotation_cam1_from_cam0)
        nees.append(error @ np.linalg.solve(pose.rotation_covariance, error))
        bound_nees.append(error @ np.linalg.solve(rotation_cramer_rao_bound(scene), error))
    assert len(nees) >= 100
    # The mean of 120 NEES of three degrees of freedom scatters by 0.22.
    assert 2.3 < np.mean(nees) < 3.7
    assert 2.3 < np.mean(bound_nees) < 3.7


@pytest.mark.parametrize(("matches", "outliers"), [(20, 0), (20, 4), (60, 30)])
def test_few_and_noisy_matches_give_a_rotation_within_its_covariance(matches, outliers):
    # Among few, chance makes some look poor, and the others better than they are.
    nees = []
    for seed in range(300):
        rng = np.random.default_rng([seed, matches])
        options = PointSceneOptions(
            camera=paper_camera(),
            matches=matches + outliers,
            outliers=outliers,
            rotation_vector_rad=tuple(np.radians(rng.uniform(-5.0, 5.0, 3))),
            translation_m=(0.0, 0.0, 0.0),
            noise_px=1.0,
        )
        scene = make_point_scene(options, seed=rng)
        pose = estimate(scene)
        if pose.status is PoseStatus.ROTATION_ONLY:
            error = rotation_error(pose, scene.rotation_cam1_from_cam0)
            nees.append(error @ np.linalg.solve(pose.rotation_covariance, error))
    assert len(nees) >= 290
    # The mean of 300 NEES of three degrees of freedom scatters by 0.14, the share by 0.013. It is a
    # little less: far points that cannot retreat tell more than the covariances know.
    assert 2.4 < np.mean(nees) < 3.5
    assert np.mean(np.array(nees) < chi2.ppf(0.95, 3)) > 0.91


def test_the_estimates_scatter_as_one_covariance_says():
    # One scene, many draws of its noise: the scatter of the estimates is the covariance reported.
    rng = np.random.default_rng(0)
    X = rng.uniform([-2.0, -1.5, 2.0], [2.0, 1.5, 6.0], (100, 3))
    camera = paper_camera()
    R, t = so3.exp(np.array([0.3, 0.1, -0.2])), np.array([0.1, 0.02, -0.15])
    clean = X / X[:, 2:], X @ R.T + t
    errors, covariances = [], []
    for _ in range(TRIALS):
        pixels = [camera.project(P) + rng.normal(0.0, 0.3, (100, 2)) for P in clean]
        pose = estimate_relative_pose(*pixels, camera)
        assert pose.status is PoseStatus.OK
        dtheta = rotation_error(pose, R)
        # In one basis for all draws.
        basis = sphere.tangent_basis(sphere.normalize(t))
        turn = basis.T @ pose.direction_basis
        J = np.zeros((5, 5))
        J[:3, :3], J[3:, 3:] = np.eye(3), turn
        errors.append(np.concatenate([dtheta, -basis.T @ pose.direction_cam1_from_cam0]))
        covariances.append(J @ pose.covariance @ J.T)
    L = np.linalg.cholesky(np.mean(covariances, axis=0))
    white = np.linalg.solve(L, np.array(errors).T)
    scatter = white @ white.T / TRIALS
    # Variances and correlations of 250 draws are known to 9 % and 6 %.
    np.testing.assert_allclose(scatter, np.eye(5), rtol=0.0, atol=0.28)
    np.testing.assert_allclose(white.mean(axis=1), 0.0, rtol=0.0, atol=4.0 / math.sqrt(TRIALS))


def test_regions_of_uncertain_directions_are_those_of_all_poses_that_they_allow():
    # Points at 25 to 35 m from 0.2 m apart: a rotation that is a little off lengthens all flow.
    held = []
    for seed in range(200):
        scene = point_scene(
            seed, matches=90, outliers=0, far_share=1.0, translation_m=(0.2, 0.0, 0.0)
        )
        pose = estimate(scene)
        if pose.status is PoseStatus.OK:
            error = pose_error(pose, scene)
            held.append(error @ np.linalg.solve(pose.covariance, error) < chi2.ppf(0.95, 5))
    assert len(held) >= 180
    # It is 0.92; those of the estimated pose alone hold it in 0.79.
    assert np.mean(held) > 0.86


def test_a_camera_that_moves_ahead_by_little_is_as_sure_as_it_is_right():
    """Two centimetres with half a pixel of noise: around the epipole, all flow is noise."""
    told = []
    for seed in range(120):
        rng = np.random.default_rng([9, seed])
        ahead = sphere.normalize(np.r_[rng.normal(0.0, 0.2, 2), rng.choice([-1.0, 1.0])])
        options = PointSceneOptions(
            camera=paper_camera(),
            matches=300,
            outliers=0,
            far_share=0.0,
            rotation_vector_rad=tuple(rng.normal(0.0, 0.02, 3)),
            translation_m=tuple(0.02 * ahead),
            noise_px=0.5,
        )
        scene = make_point_scene(options, seed=rng)
        pose = estimate(scene)
        if pose.status is not PoseStatus.OK:
            continue
        error, bound = pose_error(pose, scene), cramer_rao_bound(scene)
        size2 = error @ np.linalg.solve(pose.covariance, error)
        told.append((size2, error[3:] @ error[3:] / np.trace(bound[3:, 3:])))
    nees, ratio2 = np.array(told).T
    # By the flow that was measured: 79 of them, 1.6 times the bound, and 0.80.
    assert len(told) >= 119
    assert math.sqrt(ratio2.mean()) < 1.45
    assert np.mean(nees < chi2.ppf(0.95, 5)) > 0.9
