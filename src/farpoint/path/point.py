"""Records of camera poses along the path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["FinalPose", "PathPoint", "Rest"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Rest:
    """Evidence from landmarks that the camera does not translate, in spite of moving objects.

    Attributes
    ----------
    rotation_cam1_from_cam0 : ndarray, shape (3, 3)
        Rotation from the previous frame (camera 0) to this frame (camera 1).
    rotation_covariance : ndarray, shape (3, 3)
        Covariance of ``dtheta`` in camera 1, rad^2.
    points : int
        Number of landmarks that agree with the resection of this frame.
    """

    rotation_cam1_from_cam0: np.ndarray
    rotation_covariance: np.ndarray
    points: int


@dataclass(frozen=True, kw_only=True, eq=False)
class PathPoint:
    """Current estimate of the camera pose.

    Attributes
    ----------
    world_from_cam : ndarray, shape (4, 4)
        Transformation from camera axes to the world, whose axes are those of the first frame.
    covariance : ndarray, shape (7, 7)
        Covariance of the errors ``[dtheta (3), dposition (3), dlog_scale]`` that have accumulated
        since the beginning of the segment.
    segment : int
        Number of the path segment. A new segment begins where the motion is unknown, as at a cut.
    scale, scale_sigma : float or None
        Length of the translation from the previous frame and 1-sigma of the length; None if the
        length is unobservable.
    scale_is_guessed : bool
        Whether ``scale`` is last speed times time, because the landmarks in view could not give the
        length. All later lengths have the relative error of this ``scale``.
    rest : Rest or None
        Evidence that the camera does not translate although the two-view estimate has a
        translation; None without such evidence.
    fitting : ndarray of int64, shape (N,), or None
        Track ids of the landmarks that agree with the pose, ascending; None without resection.
    """

    world_from_cam: np.ndarray
    covariance: np.ndarray
    segment: int
    scale: float | None = None
    scale_sigma: float | None = None
    scale_is_guessed: bool = False
    rest: Rest | None = None
    fitting: np.ndarray | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class FinalPose:
    """Final pose of a frame: later frames do not change the pose.

    A pose is attached to the last keyframe at the time of the frame. The pose is final as soon as
    this keyframe has left the window, or if the pose is the oldest of more than 150 poses that are
    not final.

    Attributes
    ----------
    frame1 : int
        Index of the frame.
    timestamp : float
        Time stamp of the frame, s.
    segment : int
        Number of the path segment.
    world_from_cam : ndarray, shape (4, 4)
        Transformation from camera axes to the world, whose axes are those of the first frame.
    world_covariance : ndarray, shape (7, 7)
        Covariance of the errors ``[dtheta (3), dposition (3), dlog_scale]`` that have accumulated
        since the beginning of the segment.
    """

    frame1: int
    timestamp: float
    segment: int
    world_from_cam: np.ndarray
    world_covariance: np.ndarray
