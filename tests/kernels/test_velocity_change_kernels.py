"""Derivatives of Sampson residuals by changes of the velocity, against differences."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from farpoint._kernels.likelihood import evaluate_residuals
from farpoint._kernels.velocity_changes import sum_by_changes
from farpoint.camera import Camera
from farpoint.geometry import so3
from farpoint.geometry.sphere import tangent_basis
from farpoint.pose.general_motion import Noise, Start, linearisation_point
from farpoint.pose.matches import PixelMatches
from farpoint.pose.shutter import VelocityPrior, shutter_of

CAMERA = Camera.pinhole(640, 480, 500.0, 500.0, 319.5, 239.5)
THETA, COUNT = np.array([0.02, -0.03, 0.01]), 150
SIGMA_PX = 0.3


@pytest.fixture
def scene():
    """Pixels with residuals of about 1 px, the shutter, and a motion."""
    rng = np.random.default_rng(2)
    points0 = rng.uniform((60, 60), (580, 420), (COUNT, 2))
    t = np.array([0.5, 0.2, -0.84])
    t /= np.linalg.norm(t)
    X = CAMERA.unproject(points0) * rng.uniform(2.0, 6.0, (COUNT, 1))
    points1 = CAMERA.project(X @ so3.exp(THETA).T + 0.15 * t) + rng.normal(0.0, 1.0, (COUNT, 2))
    prior = VelocityPrior(before=np.array([0.01, 0.0, 0.02]), sigma=0.01, turn_sigma=0.1)
    shutter = shutter_of(CAMERA, points0, points1, 0.02, 0.03, prior)
    shutter = shutter._replace(changes=np.array([0.004, -0.003, 0.002, 0.02, -0.03, 0.01]))
    return PixelMatches.of(points0, points1, CAMERA, CAMERA), shutter, t


def test_sums_agree_with_differences(scene):
    pixels, shutter, t = scene
    R, basis = so3.exp(THETA), tangent_basis(t)
    noise = Noise(SIGMA_PX**2, 0.1, 0.2, 0.1)

    def point_at(x: np.ndarray):
        moved = shutter._replace(changes=shutter.changes + x[5:])
        matches = pixels.matches(partial(moved.unrolled, THETA))
        direction = t + basis @ x[3:5]
        start = Start(so3.exp(x[:3]) @ R, direction / np.linalg.norm(direction), noise, R)
        width = matches.outlier_half_width
        return matches, linearisation_point(start, width, matches.pairs, matches.weights())

    def residuals(x: np.ndarray) -> np.ndarray:
        matches, point = point_at(x)
        rows = np.empty((3, len(point.prior)))
        evaluate_residuals(point, *rows)
        return rows[0, : len(matches)]

    steps = 1e-5 * np.eye(11)
    J = np.column_stack([(residuals(step) - residuals(-step)) / 2e-5 for step in steps])
    inlier = np.random.default_rng(3).uniform(0.0, 1.0, COUNT)
    matches, point = point_at(np.zeros(11))
    H, g = np.empty((11, 11)), np.empty(11)
    phases = shutter.phase0[matches.index], shutter.phase1[matches.index]
    sum_by_changes(point, inlier, *phases, shutter.share, H, g)
    weighted = J.T * (inlier / SIGMA_PX**2)
    scale = np.sqrt(np.diag(weighted @ J))
    # The derivatives by the changes are of first order in the rotations within an image.
    expected = weighted @ J / np.outer(scale, scale)
    np.testing.assert_allclose(np.tril(H) / np.outer(scale, scale), np.tril(expected), atol=0.03)
    slope = weighted @ residuals(np.zeros(11)) / scale
    np.testing.assert_allclose(g / scale, slope, atol=0.03 * np.abs(slope).max())
