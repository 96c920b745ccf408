"""Poses, motions and their covariances in the axes and the order of ROS.

farpoint's camera axes are those of ROS's optical frames: x right, y down, z forward. A body frame
(REP 103) has x forward, y left, z up. The body is at the position of the camera; the axes of the
body are rotated camera axes. The world frame of a path has the axes of the first camera. In the
messages, the frame ``odom`` (REP 105), which has the axes of the first body, replaces the world
frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy

from farpoint.geometry import so3

__all__ = ["BODY_FROM_OPTICAL", "Twist", "motion_twist", "odom_from_body", "pose_covariance"]

BODY_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Maps coordinates in the optical frame to coordinates in the body frame."""

_ADJOINT = np.kron(np.eye(2), BODY_FROM_OPTICAL)
_TERMS = 24  # terms of the series of a Jacobian; the last one is 1e-7 for a rotation of 180 deg
_NEGLIGIBLE = 1e-17


@dataclass(frozen=True, kw_only=True, eq=False)
class Twist:
    """Velocity of a body, in the axes of the body.

    Attributes
    ----------
    linear : ndarray, shape (3,)
        Linear velocity, per second, in the unit of the length that was given to `motion_twist`.
    angular : ndarray, shape (3,)
        Angular velocity, rad/s.
    covariance : ndarray, shape (6, 6)
        Covariance of ``[linear, angular]``, which is ROS's order.
    """

    linear: np.ndarray
    angular: np.ndarray
    covariance: np.ndarray


def odom_from_body(world_from_cam: np.ndarray) -> np.ndarray:
    """Pose (4, 4) of the body in ``odom``, from the camera's pose in the world."""
    pose = np.eye(4)
    pose[:3, :3] = BODY_FROM_OPTICAL @ world_from_cam[:3, :3] @ BODY_FROM_OPTICAL.T
    pose[:3, 3] = BODY_FROM_OPTICAL @ world_from_cam[:3, 3]
    return pose


def pose_covariance(world_covariance: np.ndarray) -> np.ndarray:
    """Covariance (6, 6) of ``[x, y, z, rotation about X, Y, Z]`` in the fixed axes of ``odom``.

    Parameters
    ----------
    world_covariance : ndarray, shape (6, 6) or (7, 7)
        Covariance of ``[dtheta, dposition]`` in world axes, ``R_true = Exp(dtheta) @ R``; a seventh
        row and column are left out.
    """
    order = [3, 4, 5, 0, 1, 2]
    return _ADJOINT @ world_covariance[np.ix_(order, order)] @ _ADJOINT.T


def motion_twist(
    rotation_cam1_from_cam0: np.ndarray,
    translation: np.ndarray,
    covariance: np.ndarray,
    seconds: float,
    *,
    lever: np.ndarray | None = None,
) -> Twist:
    """The constant velocity with which the body moves from camera 0 to camera 1.

    The motion is ``X_cam1 = R X_cam0 + t``. In body axes, ``T_0_from_1 = exp(twist * seconds)``.

    Parameters
    ----------
    rotation_cam1_from_cam0 : ndarray, shape (3, 3)
        ``R``.
    translation : ndarray, shape (3,)
        ``t``, in the axes of camera 1.
    covariance : ndarray, shape (6, 6)
        Covariance of ``[dtheta, dt]``: ``R_true = Exp(dtheta) R`` and ``t_true = t + dt``, in the
        axes of camera 1.
    seconds : float
        Time between camera 0 and camera 1, s; positive.
    lever : ndarray, shape (3,), optional
        Lever arm of the rotation error; ``t`` by default.
    """
    phi = so3.log(rotation_cam1_from_cam0)
    inverse = _left_jacobian_inverse(so3.skew(phi))
    rho = inverse @ translation
    # A perturbation exp([u, dtheta]) on the left of (R, t) moves t by u + dtheta x t.
    to_left = np.zeros((6, 6))
    to_left[:3, :3] = so3.skew(translation if lever is None else lever)
    to_left[:3, 3:] = np.eye(3)
    to_left[3:, :3] = np.eye(3)
    adjoint = np.kron(np.eye(2), so3.skew(phi))
    adjoint[:3, 3:] = so3.skew(rho if lever is None else inverse @ lever)
    J = _left_jacobian_inverse(adjoint) @ to_left
    turn = -_ADJOINT / seconds  # the way back, from camera 1 to camera 0, in the body's axes
    velocity = turn @ np.concatenate([rho, phi])
    return Twist(
        linear=velocity[:3],
        angular=velocity[3:],
        covariance=turn @ (J @ covariance @ J.T) @ turn.T,
    )


def _left_jacobian_inverse(adjoint: np.ndarray) -> np.ndarray:
    """Inverse left Jacobian: for SO(3) if ``adjoint`` is 3x3, for SE(3) if ``adjoint`` is 6x6.

    The result is the sum of ``B_n / n! adjoint^n`` over n, with Bernoulli's numbers ``B_n`` (T.
    Barfoot, State Estimation for Robotics, 7.1.5).
    """
    total, power = np.zeros_like(adjoint), np.eye(len(adjoint))
    for n, number in enumerate(_bernoulli()):
        total = total + number * power
        power = power @ adjoint / (n + 1)
        if np.abs(power).max() < _NEGLIGIBLE:
            break
    return total


@cache
def _bernoulli() -> tuple[float, ...]:
    return tuple(scipy.special.bernoulli(_TERMS).tolist())
