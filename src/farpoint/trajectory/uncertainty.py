"""How sure the pose of the camera in the world is, from motion to motion.

The state has 14 components: the errors ``[dtheta (3), dp (3), dlog_scale]`` of a pose, with
``R_true = Exp(dtheta) @ R`` and ``p_true = p + dp`` of ``world_from_cam``, and behind them the
persistent errors ``[dlog_length, dtheta (3), ddirection (3)]`` of motions, in units of their
sigmas, camera axes. Trackers err in the same sense again and again: what is small in each motion
then adds up in step, not at random.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint.geometry.so3 import skew
from farpoint.pose import RelativePose
from farpoint.trajectory.scale import ScaleFit

__all__ = ["PersistentShares", "advance_moving", "advance_turning", "covariance_at_rest"]

_POSE, _PERSISTENT = 7, 7


@dataclass(frozen=True, kw_only=True)
class PersistentShares:
    """Shares, 0 to 1, of the variances of every motion that persist.

    Attributes
    ----------
    motion : float
        Of rotation and direction.
    length : float
        Of the logarithm of the length.
    """

    motion: float
    length: float


def covariance_at_rest() -> np.ndarray:
    """Covariance (14, 14) where a segment begins."""
    return np.diag(np.repeat([0.0, 1.0], [_POSE, _PERSISTENT]))


def advance_moving(
    covariance: np.ndarray,
    world_from_cam0: np.ndarray,
    motion: RelativePose,
    fit: ScaleFit,
    shares: PersistentShares,
) -> np.ndarray:
    """Covariance (14, 14) after a motion, of that before it.

    The error of the scale, which the known distances share, stays: that is how consecutive lengths,
    measured against the same points, are correlated.
    """
    R, t, basis = (
        motion.rotation_cam1_from_cam0,
        motion.direction_cam1_from_cam0,
        motion.direction_basis,
    )
    assert R is not None
    assert t is not None
    assert basis is not None
    R_world_from_cam1 = world_from_cam0[:3, :3] @ R.T
    step = -fit.scale * R_world_from_cam1 @ t
    by_pose = np.eye(_POSE)
    by_pose[3:6, :3] = -skew(step)
    by_pose[3:6, 6] = step
    by_motion = np.zeros((_POSE, 6))
    by_motion[:3, 1:4] = -R_world_from_cam1
    by_motion[3:6, 0] = step
    by_motion[3:6, 1:4] = -fit.scale * R_world_from_cam1 @ skew(t)
    by_motion[3:6, 4:] = -fit.scale * R_world_from_cam1 @ basis
    by_motion[6, 0] = fit.gain
    own = fit.covariance.copy()
    own[1:, 1:] = motion.covariance  # its own, which the distances have not corrected
    share = np.array([shares.length, *[shares.motion] * 5])
    sigma = np.sqrt(np.diag(own))
    sigma[4:] = np.sqrt(np.mean(sigma[4:] ** 2))
    persistent = np.zeros((6, _PERSISTENT))
    persistent[:4, :4] = np.diag((np.sqrt(share) * sigma)[:4])
    persistent[4:, 4:] = np.sqrt(shares.motion) * sigma[4] * basis.T
    left = np.sqrt(1.0 - share)
    return _advanced(covariance, by_pose, by_motion, own * np.outer(left, left), persistent)


def advance_turning(
    covariance: np.ndarray,
    world_from_cam0: np.ndarray,
    motion: RelativePose,
    shares: PersistentShares,
) -> np.ndarray:
    """Covariance (14, 14) after a motion without translation."""
    assert motion.rotation_cam1_from_cam0 is not None
    assert motion.rotation_covariance is not None
    by_motion = np.zeros((_POSE, 3))
    by_motion[:3] = -world_from_cam0[:3, :3] @ motion.rotation_cam1_from_cam0.T
    own = motion.rotation_covariance
    persistent = np.zeros((3, _PERSISTENT))
    persistent[:, 1:4] = np.diag(np.sqrt(shares.motion * np.diag(own)))
    return _advanced(covariance, np.eye(_POSE), by_motion, (1.0 - shares.motion) * own, persistent)


def _advanced(
    covariance: np.ndarray,
    by_pose: np.ndarray,
    by_motion: np.ndarray,
    own: np.ndarray,
    persistent: np.ndarray,
) -> np.ndarray:
    F = np.eye(_POSE + _PERSISTENT)
    F[:_POSE, :_POSE] = by_pose
    F[:_POSE, _POSE:] = by_motion @ persistent
    after = F @ covariance @ F.T
    after[:_POSE, :_POSE] += by_motion @ own @ by_motion.T
    return after
