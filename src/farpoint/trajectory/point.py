"""A point of the path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["PathPoint"]


@dataclass(frozen=True, kw_only=True, eq=False)
class PathPoint:
    """Where the camera is.

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
    """

    world_from_cam: np.ndarray
    covariance: np.ndarray
    segment: int
    scale: float | None = None
    scale_sigma: float | None = None
    scale_is_guessed: bool = False
