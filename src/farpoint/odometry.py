"""Images in, motions out: no files, no printing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint.pose import RelativePose
from farpoint.tracks import Tracks

__all__ = ["OdometryResult"]


@dataclass(frozen=True, kw_only=True, eq=False)
class OdometryResult:
    """What one frame added.

    Attributes
    ----------
    frame0, frame1 : int
        Indices of the earlier frame this one was compared with, and of this one. On the first
        frame both are its own.
    timestamp0, timestamp : float
        Their times, s.
    pose : RelativePose or None
        Motion from ``frame0`` to ``frame1``; None on the first frame, which has nothing to be
        compared with.
    tracks : Tracks
        The matches behind the pose, aligned with ``pose.labels``.
    world_from_cam : ndarray, shape (4, 4)
        Camera axes to world; the first frame is the world.
    scale, scale_sigma : float or None
        Length of the translation of this pair in the unit of the trajectory, and its 1-sigma;
        None where there is none.
    """

    frame0: int
    frame1: int
    timestamp0: float
    timestamp: float
    pose: RelativePose | None
    tracks: Tracks
    world_from_cam: np.ndarray
    scale: float | None
    scale_sigma: float | None
