"""The sinks ``trajectory.tum`` and ``trajectory.kitti``: where the camera was, a line per frame."""

from __future__ import annotations

from farpoint.odometry import OdometryResult
from farpoint.sinks.sink import TextSink
from farpoint.trajectory.files import kitti_line, tum_line

__all__ = ["KittiFile", "TrajectoryFile"]


class TrajectoryFile(TextSink):
    """Writes ``timestamp tx ty tz qx qy qz qw`` of ``world_from_cam``."""

    def lines(self, result: OdometryResult) -> str:
        """The line of this frame."""
        return tum_line(result.timestamp, result.world_from_cam)


class KittiFile(TextSink):
    """Writes the upper 3x4 of ``world_from_cam``, row by row, without time stamps."""

    def lines(self, result: OdometryResult) -> str:
        """The line of this frame."""
        return kitti_line(result.world_from_cam)
