"""How sure the pose of the camera in the world is, from motion to motion."""

from __future__ import annotations

import numpy as np

from farpoint.geometry.so3 import skew
from farpoint.pose import RelativePose
from farpoint.trajectory.scale import ScaleFit

__all__ = ["advance_moving", "advance_turning"]


def advance_moving(
    covariance: np.ndarray, world_from_cam0: np.ndarray, motion: RelativePose, fit: ScaleFit
) -> np.ndarray:
    """Covariance (7, 7) after a motion, of that before it.

    Errors are ``[dtheta (3), dp (3), dlog_scale]``: ``R_true = Exp(dtheta) @ R`` and
    ``p_true = p + dp`` of ``world_from_cam``, and the error of the scale that the known distances
    share. It stays: that is how consecutive motions, which see the same points, are correlated.
    """
    R, t, basis = (
        motion.rotation_cam1_from_cam0,
        motion.direction_cam1_from_cam0,
        motion.direction_basis,
    )
    assert R is not None
    assert t is not None
    assert basis is not None
    R_world_from_cam0 = world_from_cam0[:3, :3]
    R_world_from_cam1 = R_world_from_cam0 @ R.T
    step = -fit.scale * R_world_from_cam1 @ t
    A = np.eye(7)
    A[3:6, :3] = -skew(step)
    A[3:6, 6] = step
    B = np.zeros((7, 6))
    B[:3, 1:4] = -R_world_from_cam1
    B[3:6, 0] = step
    B[3:6, 1:4] = -fit.scale * R_world_from_cam1 @ skew(t)
    B[3:6, 4:] = -fit.scale * R_world_from_cam1 @ basis
    B[6, 0] = fit.gain
    return A @ covariance @ A.T + B @ _of_motion(motion, fit) @ B.T


def advance_turning(
    covariance: np.ndarray, world_from_cam0: np.ndarray, motion: RelativePose
) -> np.ndarray:
    """Covariance (7, 7) after a motion without translation."""
    assert motion.rotation_cam1_from_cam0 is not None
    assert motion.rotation_covariance is not None
    R = world_from_cam0[:3, :3] @ motion.rotation_cam1_from_cam0.T
    after = covariance.copy()
    after[:3, :3] += R @ motion.rotation_covariance @ R.T
    return after


def _of_motion(motion: RelativePose, fit: ScaleFit) -> np.ndarray:
    """Covariance (6, 6) of ``[log(scale), dtheta, dbeta]``: the motion's own is not corrected."""
    joint = fit.covariance.copy()
    joint[1:, 1:] = motion.covariance
    return joint
