"""Estimates made up for tests of what a result can be turned into."""

from __future__ import annotations

import numpy as np

from farpoint import PoseStats, PoseStatus, RelativePose
from farpoint.geometry import so3, sphere

STATS = PoseStats(
    matches=0,
    far=0,
    near=0,
    outliers=0,
    iterations=0,
    cost=1.0,
    sign_probability=None,
    sharing=1.0,
    half_ratio=None,
    search_s=0.0,
    refinement_s=0.0,
    covariance_s=0.0,
)
"""Of an estimate that nobody made."""


def made_pose(
    *,
    direction: tuple[float, float, float] = (-0.3, 0.1, -1.0),
    sigma_rad: float = 1e-3,
    seed: int = 0,
) -> RelativePose:
    """An OK estimate with a full covariance, and a tangent basis unlike anybody's default."""
    rng = np.random.default_rng(seed)
    d = sphere.normalize(np.array(direction))
    turn = so3.exp(rng.uniform(0.5, 2.5) * d)
    root = sigma_rad * (np.eye(5) + 0.4 * rng.normal(size=(5, 5)))
    covariance = root @ root.T
    return RelativePose(
        status=PoseStatus.OK,
        reason="Made up.",
        rotation_cam1_from_cam0=so3.exp(rng.normal(scale=0.4, size=3)),
        rotation_covariance=covariance[:3, :3],
        direction_cam1_from_cam0=d,
        direction_basis=turn @ sphere.tangent_basis(d),
        covariance=covariance,
        labels=np.empty(0, np.uint8),
        noise_px=None,
        stats=STATS,
    )


def without_direction(pose: RelativePose) -> RelativePose:
    """The same rotation, nothing known of the direction."""
    return RelativePose(
        status=PoseStatus.ROTATION_ONLY,
        reason="Made up.",
        rotation_cam1_from_cam0=pose.rotation_cam1_from_cam0,
        rotation_covariance=pose.rotation_covariance,
        direction_cam1_from_cam0=None,
        direction_basis=None,
        covariance=None,
        labels=pose.labels,
        noise_px=None,
        stats=STATS,
    )


def true_motion(pose: RelativePose, tangent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and unit direction that differ from the estimate by ``[dtheta, dbeta]``."""
    assert pose.rotation_cam1_from_cam0 is not None
    assert pose.direction_cam1_from_cam0 is not None
    assert pose.direction_basis is not None
    R = so3.exp(tangent[:3]) @ pose.rotation_cam1_from_cam0
    return R, sphere.retract(pose.direction_cam1_from_cam0, pose.direction_basis, tangent[3:])


def draws(pose: RelativePose, count: int, seed: int) -> np.ndarray:
    """Samples (count, 5) of the estimate's own error."""
    assert pose.covariance is not None
    rng = np.random.default_rng(seed)
    return rng.multivariate_normal(np.zeros(5), pose.covariance, size=count, method="cholesky")
