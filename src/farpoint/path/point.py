"""Records of camera poses along the path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["FinalPose", "PathPoint", "Rest"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Rest:
    """Evidence of landmarks that the camera is at rest, in spite of moving objects.

    Attributes
    ----------
    rotation_cam1_from_cam0 : ndarray, shape (3, 3)
        From the previous frame to this one.
    rotation_covariance : ndarray, shape (3, 3)
        Covariance of ``dtheta`` in camera 1, rad^2.
    points : int
        Number of landmarks that fit.
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
        Camera axes to world; the first frame is the world.
    covariance : ndarray, shape (7, 7)
        Covariance of ``[dtheta (3), dposition (3), dlog_scale]`` since the beginning of the
        segment.
    segment : int
        Number of the path segment; scale or tracking was lost between segments.
    scale, scale_sigma : float or None
        Length of the last frame-to-frame translation and its 1-sigma; None where unobservable.
    scale_is_guessed : bool
        Whether the length is extrapolated from the last speed, for lack of landmarks; later lengths
        are relative to it.
    rest : Rest or None
        Set where landmarks are static although the two-view estimate has a translation.
    fitting : ndarray of int64, shape (N,)
        Tracks of landmarks that fit the pose, ascending.
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
    """A final pose.

    Attributes
    ----------
    frame1 : int
        Index of the frame.
    timestamp : float
        Seconds.
    segment : int
        Segment of the path.
    world_from_cam : ndarray, shape (4, 4)
        Camera axes to world; the first frame is the world.
    world_covariance : ndarray, shape (7, 7)
        Covariance of ``[dtheta (3), dposition (3), dlog_scale]`` since the beginning of the
        segment.
    """

    frame1: int
    timestamp: float
    segment: int
    world_from_cam: np.ndarray
    world_covariance: np.ndarray
