"""The result of one frame: its motion, its tracks, and the pose of the camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint.pose import RelativePose
from farpoint.pose.html_repr import html_table, pose_rows
from farpoint.tracks import Tracks

__all__ = ["OdometryResult"]


@dataclass(frozen=True, kw_only=True, eq=False)
class OdometryResult:
    """Result of one frame.

    Attributes
    ----------
    frame0, frame1 : int
        Indices of the earlier frame and of this frame. On the first frame both are equal.
    timestamp0, timestamp : float
        Times of both frames, s.
    pose : RelativePose or None
        Motion from ``frame0`` to ``frame1``; None on the first frame.
    tracks : Tracks
        The matches from which the pose was estimated, in the order of ``pose.labels``.
    world_from_cam : ndarray, shape (4, 4)
        Pose of the camera: transformation from camera axes to the world. The axes of the first
        frame are the world axes.
    scale, scale_sigma : float or None
        Length of the translation from ``frame0`` to ``frame1`` and 1-sigma of the length, in units
        of the trajectory. The unit is the length of the first observable translation. The first
        translation of a later segment has the length ``last speed * time``. None without a
        translation.
    world_covariance : ndarray, shape (7, 7), or None
        Covariance of the errors ``[dtheta (3), dposition (3), dlog_scale]`` that have accumulated
        since the beginning of the segment, in world axes, rad and units of the trajectory. The
        rotation R and the position p of ``world_from_cam`` have the errors ``R_true = Exp(dtheta)
        @ R`` and ``p_true = p + dposition``. ``dlog_scale`` is the error of the logarithm of the
        scale, which all later motions share.
    segment : int
        Number of the segment, from 0. A new segment begins at a frame whose motion from the last
        frame is unknown: at a cut, or where the time stamp decreases. All lengths of a segment are
        on one scale.
    scale_is_guessed : bool
        Whether ``scale`` is last speed times time, because no point of known distance was in view
        after a pure rotation. ``scale_sigma`` and all later covariances include the uncertainty of
        the speed.
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
        """HTML for notebooks: frames, pose of the camera, and the motion."""
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
