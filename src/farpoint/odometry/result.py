"""What one frame adds: the motion, its tracks, and where the camera is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint.pose import RelativePose
from farpoint.pose.html_repr import html_table, pose_rows
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
        Length of the translation of this pair in the unit of the trajectory, which is the first
        motion of the segment, and its 1-sigma; None where there is none.
    world_covariance : ndarray, shape (7, 7), or None
        Of ``[dtheta (3), dposition (3), dlog_scale]`` since the beginning of the segment:
        ``R_true = Exp(dtheta) @ R`` and ``p_true = p + dposition`` of ``world_from_cam``, world
        axes, rad and units of the trajectory, and the error of the scale that all later motions
        share.
    segment : int
        0, and one more from each frame at which the scale was lost, or everything, as at a cut:
        lengths within a segment have one scale.
    scale_is_guessed : bool
        Whether ``scale`` is what the last speed suggests, since after a turn on the spot no point
        of known distance was in view: ``scale_sigma`` and the covariance from here on say so too.
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
    world_covariance: np.ndarray | None = None
    segment: int = 0
    scale_is_guessed: bool = False

    def _repr_html_(self) -> str:
        """What a notebook shows: which frames, where the camera is, and the motion."""
        x, y, z = self.world_from_cam[:3, 3]
        rows = [
            ("frames", f"{self.frame0} to {self.frame1}"),
            ("times", f"{self.timestamp0:.3f} s to {self.timestamp:.3f} s"),
            ("position x, y, z", f"{x:+.3f}, {y:+.3f}, {z:+.3f}"),
        ]
        status = "first frame" if self.pose is None else self.pose.status.value
        return html_table(
            f"OdometryResult: {status}", rows + ([] if self.pose is None else pose_rows(self.pose))
        )
