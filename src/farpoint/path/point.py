"""A point of the path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["PathPoint", "Rest", "SettledPose"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Rest:
    """What known points tell of a camera that stands, whatever moves before it.

    Attributes
    ----------
    rotation_cam1_from_cam0 : ndarray, shape (3, 3)
        Since the last frame.
    rotation_covariance : ndarray, shape (3, 3)
        Of ``dtheta`` in camera 1, rad^2.
    points : int
        How many points tell it.
    """

    rotation_cam1_from_cam0: np.ndarray
    rotation_covariance: np.ndarray
    points: int


@dataclass(frozen=True, kw_only=True, eq=False)
class PathPoint:
    """Where the camera is, as far as is known now.

    Attributes
    ----------
    world_from_cam : ndarray, shape (4, 4)
        Camera axes to world; the first frame is the world.
    covariance : ndarray, shape (7, 7)
        Of ``[dtheta (3), dposition (3), dlog_scale]`` since the beginning of the segment.
    segment : int
        Counts the parts of the path between which the scale, or everything, was lost.
    scale, scale_sigma : float or None
        Length of the last motion, frame to frame, and its 1-sigma; None where it has none.
    scale_is_guessed : bool
        Whether that length is what the last speed suggests, for want of any known point: later
        lengths are measured by it.
    rest : Rest or None
        Where known points stand still though the two views tell of a motion.
    fitting : ndarray of int64, shape (N,)
        Tracks of known points that fit the pose, ascending.
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
class SettledPose:
    """A pose that changes no more.

    Attributes
    ----------
    frame : int
        Index of the frame.
    timestamp : float
        Seconds.
    segment : int
        Of the path.
    world_from_cam : ndarray, shape (4, 4)
        Camera axes to world; the first frame is the world.
    covariance : ndarray, shape (7, 7)
        Of ``[dtheta (3), dposition (3), dlog_scale]`` since the beginning of the segment.
    """

    frame: int
    timestamp: float
    segment: int
    world_from_cam: np.ndarray
    covariance: np.ndarray
