"""Rays in any direction: no lens, no axis, and the epipole anywhere on the sphere."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from pose_kit import direction_error, rotation_error

from farpoint import PoseStatus, estimate_relative_pose_from_rays
from farpoint.geometry import so3, sphere
from farpoint.metrics import chi2_quantile

MATCHES, WRONG = 120, 20
NOISE_RAD = math.radians(0.05)
TRIALS = 500


@dataclass(frozen=True, kw_only=True)
class RayScene:
    """Matches all around, the truth, and the least covariance (5, 5) of ``[dtheta, dbeta]``."""

    rays0: np.ndarray
    rays1: np.ndarray
    R: np.ndarray
    direction: np.ndarray
    bound: np.ndarray


def ray_scene(seed: int) -> RayScene:
    """Points 1-4 m away all around a camera that turns up to 10 deg and moves by 0.2 m."""
    rng = np.random.default_rng(seed)
    R = so3.exp(math.radians(10.0) * rng.uniform() * sphere.normalize(rng.normal(size=3)))
    direction = sphere.normalize(rng.normal(size=3))
    a = sphere.normalize(rng.normal(size=(MATCHES, 3)))
    distance = rng.uniform(1.0, 4.0, (MATCHES, 1))
    b = sphere.normalize(a @ R.T + 0.2 / distance * direction)
    right = slice(WRONG, None)
    bound = ray_bound(a[right], b[right], R, direction)
    b[:WRONG] = sphere.normalize(rng.normal(size=(WRONG, 3)))
    return RayScene(
        rays0=shaken(a, rng), rays1=shaken(b, rng), R=R, direction=direction, bound=bound
    )


def shaken(rays: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    steps = rng.normal(0.0, NOISE_RAD, (len(rays), 2))
    return sphere.normalize(rays + np.einsum("nij,nj->ni", sphere.tangent_basis(rays), steps))


def ray_bound(a: np.ndarray, b: np.ndarray, R: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Cramer-Rao bound: each match is one constraint ``b . (t x R a) = 0`` between its noises."""
    turned = a @ R.T
    by_b = np.cross(direction, turned)
    by_turned = np.cross(b, direction)
    by_theta = np.cross(turned, by_turned)
    by_beta = np.cross(turned, b) @ sphere.tangent_basis(direction)
    jacobian = np.concatenate([by_theta, by_beta], axis=1)
    # What moves a ray along itself moves nothing.
    across_b = by_b - np.sum(by_b * b, axis=1, keepdims=True) * b
    across_a = by_turned - np.sum(by_turned * turned, axis=1, keepdims=True) * turned
    variance = NOISE_RAD**2 * (np.sum(across_a**2, axis=1) + np.sum(across_b**2, axis=1))
    return np.linalg.inv(jacobian.T @ (jacobian / variance[:, None]))


@pytest.fixture(scope="module")
def figures() -> dict[str, np.ndarray]:
    """Squared errors in terms of the claimed covariance and of the bound, trial by trial."""
    rows = []
    for seed in range(TRIALS):
        scene = ray_scene(seed)
        pose = estimate_relative_pose_from_rays(scene.rays0, scene.rays1, noise_rad=NOISE_RAD)
        assert pose.status is PoseStatus.OK, seed
        turn = rotation_error(pose, scene.R)
        error = np.concatenate([turn, direction_error(pose, scene.direction)])
        # The bound's basis of the direction's plane is not the estimate's: only lengths compare.
        off = sphere.angle_between(pose.direction_cam1_from_cam0, scene.direction)
        rows.append(
            (
                error @ np.linalg.solve(pose.covariance, error),
                turn @ np.linalg.solve(pose.covariance[:3, :3], turn),
                error[3:] @ np.linalg.solve(pose.covariance[3:, 3:], error[3:]),
                turn @ turn / np.trace(scene.bound[:3, :3]),
                off**2 / np.trace(scene.bound[3:, 3:]),
            )
        )
    columns = np.array(rows).T
    names = ("pose", "rotation", "direction", "rotation_over_bound", "direction_over_bound")
    return dict(zip(names, columns, strict=True))


@pytest.mark.parametrize("part", ["rotation", "direction"])
def test_errors_are_at_the_bound(figures, part):
    assert math.sqrt(np.mean(figures[f"{part}_over_bound"])) < 1.15


@pytest.mark.parametrize(("part", "dof"), [("pose", 5), ("rotation", 3), ("direction", 2)])
def test_covariances_hold(figures, part, dof):
    covered = float(np.mean(figures[part] <= chi2_quantile(0.95, dof)))
    # 0.93 to 0.97, and the two sigma by which chance moves 500 trials.
    assert 0.91 <= covered <= 0.99


def test_the_bound_is_what_least_squares_with_known_matches_reaches():
    """The bound by another way: the curvature of the best fit's cost, by differences."""
    scene = ray_scene(3)
    a, b = scene.rays0[WRONG:], scene.rays1[WRONG:]
    basis = sphere.tangent_basis(scene.direction)

    def residuals(step: np.ndarray) -> np.ndarray:
        R = so3.exp(step[:3]) @ scene.R
        t = sphere.normalize(scene.direction + basis @ step[3:])
        turned = a @ R.T
        e = np.sum(b * np.cross(t, turned), axis=1)
        variance = 2.0 - (turned @ t) ** 2 - (b @ t) ** 2 - 2.0 * e**2
        return e / np.sqrt(variance) / NOISE_RAD

    h = 1e-5
    jacobian = np.stack([(residuals(h * d) - residuals(-h * d)) / (2 * h) for d in np.eye(5)], 1)
    covariance = np.linalg.inv(jacobian.T @ jacobian)
    np.testing.assert_allclose(covariance, scene.bound, atol=0.05 * np.abs(scene.bound).max())
