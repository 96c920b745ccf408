"""How sure the pose of the camera in the world is, from motion to motion.

The state has 26 components: the errors ``[dtheta (3), dp (3), dlog_scale]`` of a pose, with
``R_true = Exp(dtheta) @ R`` and ``p_true = p + dp`` of ``world_from_cam``, and behind them white
ones that motions share. First, in camera axes, persistent ones ``[dlog_length, dtheta (3),
ddirection (3)]`` and fading ones ``[dtheta (3), ddirection (3)]``: trackers err in the same sense
for as long as the same things are in view, and in part always: what is small in each motion then
adds up in step, not at random. What is shared of a motion has the correlations of the motion's own
error: a rotation that is off makes a direction that is off. Then those that bend all distances at
once (`farpoint.trajectory.depths`), for they are errors of the motions that have measured these:
later lengths inherit them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint.geometry.so3 import skew
from farpoint.pose import RelativePose
from farpoint.trajectory.chain import parts_of
from farpoint.trajectory.depths import BENDS, ERRORS
from farpoint.trajectory.moved import Moved, MovedUnseen
from farpoint.trajectory.scale import ScaleFit

__all__ = [
    "SharedErrors",
    "advance_moving",
    "advance_turning",
    "advance_unseen",
    "condense",
    "covariance_at_rest",
    "length_variance_shared",
]

_POSE, _MOTION = 7, 6
_PERSISTENT = slice(_POSE, _POSE + 1 + _MOTION)
_FADING = slice(_PERSISTENT.stop, _PERSISTENT.stop + _MOTION)
_BENDS = slice(_FADING.stop, _FADING.stop + BENDS)
_WHITE = _FADING.stop - _POSE
_STATE = _BENDS.stop


@dataclass(frozen=True, kw_only=True)
class SharedErrors:
    """Shares, 0 to 1, of the variances of every motion that others have in common with it.

    Attributes
    ----------
    persistent_motion : float
        Of rotation and direction: what all motions share.
    persistent_length : float
        The same of the logarithm of the length.
    fading_motion : float
        Of rotation and direction: what motions share that are close to each other.
    fading_motions : float
        Number of motions after which that share has gone down to 1 / e.
    """

    persistent_motion: float
    persistent_length: float
    fading_motion: float
    fading_motions: float


def covariance_at_rest() -> np.ndarray:
    """Covariance (26, 26) where a segment begins."""
    return np.diag(np.repeat([0.0, 1.0], [_POSE, _STATE - _POSE]))


def advance_moving(
    covariance: np.ndarray,
    world_from_cam0: np.ndarray,
    motion: RelativePose,
    moved: Moved,
    shared: SharedErrors,
) -> np.ndarray:
    """Covariance (32, 32) after a motion, of that before it (26, 26).

    The error of the scale, which the known distances share, stays: that is how consecutive lengths,
    measured against the same points, are correlated. The motion's own errors, six white ones, are
    added at the end, for they are in the distances now: see `condense`.
    """
    fit, (_, _, basis) = moved.fit, parts_of(motion)
    by_pose, by_motion = _derivatives(world_from_cam0, motion, fit)
    own = fit.covariance.copy()
    own[1:, 1:] = motion.covariance  # which the distances have not corrected
    length_share = shared.persistent_length if fit.points else 0.0  # the rest is no measurement
    by_white = np.zeros((6, _WHITE))
    by_white[0, 0] = np.sqrt(length_share * own[0, 0])
    by_white[1:, 1:] = _shared_parts(_root(own[1:, 1:], basis), shared)
    alone = 1.0 - shared.persistent_motion - shared.fading_motion
    left = np.sqrt([1.0 - length_share, *[alone] * 5])
    by_bends = by_motion[:, :1] @ moved.inherited[:1]
    if moved.is_resected:
        by_bends = by_motion @ moved.inherited
    by_bends[6] = moved.inherited[0]
    after = np.eye(_STATE + ERRORS)
    after[:_STATE, :_STATE] = _advanced(
        covariance, by_pose, by_motion, own * np.outer(left, left), by_white, by_bends, shared
    )
    after[:_POSE, _STATE:] = by_motion @ (left[:, None] * fit.root)
    after[_STATE:, :_POSE] = after[:_POSE, _STATE:].T
    return after


def condense(covariance: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Covariance (26, 26) of that after a motion, with `Depths.condense` of what it has measured.

    ``axes`` (9 or 12, BENDS) are the errors of the distances that are kept, in terms of all.
    """
    to_few = np.zeros((len(covariance), _STATE))
    to_few[: _BENDS.start, : _BENDS.start] = np.eye(_BENDS.start)
    to_few[_BENDS.start :, _BENDS] = axes
    return to_few.T @ covariance @ to_few


def length_variance_shared(covariance: np.ndarray, moved: Moved) -> float:
    """Variance of the logarithm of a length by errors of the distances before it."""
    by_state = np.zeros(_STATE)
    by_state[6], by_state[_BENDS] = 1.0, moved.inherited[0]
    return float(by_state @ covariance @ by_state)


def advance_turning(
    covariance: np.ndarray,
    world_from_cam0: np.ndarray,
    motion: RelativePose,
    shared: SharedErrors,
) -> np.ndarray:
    """Covariance (26, 26) after a motion without translation."""
    assert motion.rotation_cam1_from_cam0 is not None
    assert motion.rotation_covariance is not None
    by_motion = np.zeros((_POSE, 3))
    by_motion[:3] = -world_from_cam0[:3, :3] @ motion.rotation_cam1_from_cam0.T
    own = motion.rotation_covariance
    by_white = np.zeros((3, _WHITE))
    by_white[:, 1:] = _shared_parts(np.hstack([_symmetric_root(own), np.zeros((3, 3))]), shared)
    alone = 1.0 - shared.persistent_motion - shared.fading_motion
    none = np.zeros((_POSE, BENDS))
    return _advanced(covariance, np.eye(_POSE), by_motion, alone * own, by_white, none, shared)


def advance_unseen(
    covariance: np.ndarray,
    world_from_cam0: np.ndarray,
    motion: RelativePose,
    moved: MovedUnseen,
    shared: SharedErrors,
) -> np.ndarray:
    """Covariance (29, 29) after a motion with a translation that nobody has seen.

    Its three parts, white ones in camera axes, are added at the end: see `condense`.
    """
    turned = advance_turning(covariance, world_from_cam0, motion, shared)
    assert motion.rotation_cam1_from_cam0 is not None
    by_unseen = np.zeros((_STATE, 3))
    by_unseen[3:6] = -moved.sigma * world_from_cam0[:3, :3] @ motion.rotation_cam1_from_cam0.T
    return np.block([[turned + by_unseen @ by_unseen.T, by_unseen], [by_unseen.T, np.eye(3)]])


def _derivatives(
    world_from_cam0: np.ndarray, motion: RelativePose, fit: ScaleFit
) -> tuple[np.ndarray, np.ndarray]:
    """Of the next pose (7,) by the one before (7, 7), and by length and motion (7, 6)."""
    R, t, basis = parts_of(motion)
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
    return by_pose, by_motion


def _shared_parts(root: np.ndarray, shared: SharedErrors) -> np.ndarray:
    """By persistent and by fading errors (D, 12), of the root (D, 6) of a motion's covariance."""
    shares = np.sqrt([shared.persistent_motion, shared.fading_motion])
    return np.hstack([share * root for share in shares])


def _root(covariance: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """Root (5, 6) of a motion's covariance (5, 5), by white errors in camera axes.

    Of all roots the symmetric one, directions in the three axes of the camera and both parts in
    units of their sigmas: it changes from motion to motion no more than the covariance does.
    """
    to_axes = np.zeros((6, 5))
    to_axes[:3, :3], to_axes[3:, 3:] = np.eye(3), basis
    rotation, direction = np.trace(covariance[:3, :3]) / 3.0, np.trace(covariance[3:, 3:]) / 2.0
    sigma = np.sqrt(np.repeat([rotation, direction], 3))
    white = (to_axes @ covariance @ to_axes.T) / np.outer(sigma, sigma)
    return to_axes.T @ (sigma[:, None] * _symmetric_root(white))


def _symmetric_root(covariance: np.ndarray) -> np.ndarray:
    values, axes = np.linalg.eigh(covariance)
    return (axes * np.sqrt(np.maximum(values, 0.0))) @ axes.T


def _advanced(
    covariance: np.ndarray,
    by_pose: np.ndarray,
    by_motion: np.ndarray,
    own: np.ndarray,
    by_white: np.ndarray,
    by_bends: np.ndarray,
    shared: SharedErrors,
) -> np.ndarray:
    kept = np.exp(-1.0 / shared.fading_motions)
    F = np.eye(_STATE)
    F[:_POSE, :_POSE] = by_pose
    F[:_POSE, _POSE : _FADING.stop] = by_motion @ by_white
    F[:_POSE, _BENDS] = by_bends
    F[_FADING, _FADING] *= kept
    after = F @ covariance @ F.T
    after[:_POSE, :_POSE] += by_motion @ own @ by_motion.T
    after[_FADING, _FADING] += (1.0 - kept**2) * np.eye(_MOTION)
    return after
