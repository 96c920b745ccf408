"""What a lens that is known only roughly does to a motion and its covariance."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from farpoint.camera import Camera
from farpoint.geometry import so3
from farpoint.pose.result import PoseStatus, RelativePose, TrackLabel

__all__ = ["with_lens_doubt"]

# A direction that a lens one sigma off turns farther (rad) is the lens's, not the motion's.
_MAX_TURN = math.radians(20.0)


def with_lens_doubt(camera: Camera, estimate: Callable[[Camera], RelativePose]) -> RelativePose:
    """The motion that a camera gives, its covariance widened by what its doubts would change.

    A wrong focal length or distortion is no noise: it is wrong for all matches alike, and no number
    of them averages it away. With ``d`` the change of ``[dtheta, dbeta]`` under a lens that is one
    sigma off, one way or the other, the covariance grows by ``sum d d.T / 2``.

    A wrong lens also makes a translation of what was a rotation. A direction that is not there with
    every lens in doubt, or turns far with one, is none: then the rotation alone is given.

    Parameters
    ----------
    camera : Camera
        With its ``doubts``; without any, the estimate is returned as it is.
    estimate : callable
        The motion by a camera, from always the same matches.
    """
    pose = estimate(camera)
    if pose.status is PoseStatus.FAILED:
        return pose
    others = [estimate(replace(camera, model=model, doubts=())) for model in camera.doubts]
    others = [other for other in others if other.status is not PoseStatus.FAILED]
    if not others:
        return pose
    if pose.status is PoseStatus.OK and _largest_turn(pose, others) > _MAX_TURN:
        pose = _without_direction(pose)
    return _widened(pose, others)


def _largest_turn(pose: RelativePose, others: list[RelativePose]) -> float:
    """How far, rad, another lens turns the direction; infinite where one leaves none."""
    found = all(other.status is PoseStatus.OK for other in others)
    turns = [float(np.linalg.norm(_change(pose, other)[3:])) for other in others]
    return max(turns, default=0.0) if found else math.inf


def _without_direction(pose: RelativePose) -> RelativePose:
    stats = pose.stats
    return replace(
        pose,
        status=PoseStatus.ROTATION_ONLY,
        reason="The camera's lens is only guessed, and what looks like a translation may be the "
        "guess's error.",
        direction_cam1_from_cam0=None,
        direction_basis=None,
        covariance=None,
        labels=np.minimum(pose.labels, np.uint8(TrackLabel.FAR)),
        stats=replace(stats, far=stats.far + stats.near, near=0, sign_probability=None),
    )


def _widened(pose: RelativePose, others: list[RelativePose]) -> RelativePose:
    changes = np.array([_change(pose, other) for other in others]).reshape(len(others), -1)
    spread = changes.T @ changes / 2.0
    rotation_covariance, covariance = pose.rotation_covariance, pose.covariance
    assert rotation_covariance is not None
    return replace(
        pose,
        rotation_covariance=rotation_covariance + spread[:3, :3],
        covariance=None if covariance is None else covariance + spread,
    )


def _change(pose: RelativePose, other: RelativePose) -> np.ndarray:
    """``[dtheta, dbeta]`` from one pose to the other; where one has no direction, ``dtheta``."""
    R, R_other = pose.rotation_cam1_from_cam0, other.rotation_cam1_from_cam0
    assert R is not None
    assert R_other is not None
    turn = so3.log(R_other @ R.T)
    direction, basis = pose.direction_cam1_from_cam0, pose.direction_basis
    towards = other.direction_cam1_from_cam0
    if direction is None or basis is None or towards is None:
        return turn
    across = basis.T @ towards
    angle = np.arctan2(np.linalg.norm(across), direction @ towards)
    # As long as the angle, not its tangent: there may be a right one between them.
    return np.concatenate([turn, across * (angle / max(float(np.linalg.norm(across)), 1e-300))])
