"""Rotations of motions whose flow is too short for a direction."""

from __future__ import annotations

import numpy as np
import pytest
from pose_kit import estimate, point_scene, rotation_error

from farpoint import PoseStatus
from farpoint.metrics import chi2_quantile

SHORT = (
    {"matches": 90, "translation_m": (0.02, 0.0, 0.0)},
    {"matches": 90, "translation_m": (0.02, 0.0, 0.0), "outliers": 18},
    {"matches": 90, "translation_m": (0.02, 0.0, 0.02)},
    {"matches": 300, "translation_m": (0.013, 0.0, 0.0)},
)


@pytest.fixture(scope="module")
def squares() -> np.ndarray:
    """Squared errors in terms of the covariances, of 3 degrees of freedom each."""
    found = []
    for options in SHORT:
        for seed in range(1500):
            scene = point_scene(seed, noise_px=1.0, far_share=0.5, **options)
            pose = estimate(scene)
            if pose.status is PoseStatus.ROTATION_ONLY and "Insufficient parallax" in pose.reason:
                error = rotation_error(pose, scene.rotation_cam1_from_cam0)
                found.append(error @ np.linalg.solve(pose.rotation_covariance, error))
    return np.array(found)


def test_they_are_found(squares):
    assert squares.size >= 80


def test_they_lie_within_their_covariances(squares):
    # Of 3,000 more seeds 0.893 +- 0.018 of 290 (before candidates were pooled 0.898 of 303).
    assert np.mean(squares <= chi2_quantile(0.95, 3)) >= 0.87


def test_their_covariances_are_not_far_too_large(squares):
    # With as much doubt about every axis as about that on which turn and motion differ: 0.58.
    assert squares.mean() / 3.0 > 0.7
