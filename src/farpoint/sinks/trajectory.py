"""``trajectory.tum`` and ``trajectory.kitti``: a pose per frame."""

from __future__ import annotations

from farpoint.sinks.sink import PathFile, Posed
from farpoint.trajectory.files import kitti_line, tum_line

__all__ = ["KittiFile", "TrajectoryFile"]


class TrajectoryFile(PathFile):
    """Writes ``timestamp tx ty tz qx qy qz qw`` of ``world_from_cam``."""

    def lines(self, pose: Posed) -> str:
        """The line of this frame."""
        return tum_line(pose.timestamp, pose.world_from_cam)


class KittiFile(PathFile):
    """Writer of the upper 3x4 part of ``world_from_cam``, row by row, without time stamps."""

    def lines(self, pose: Posed) -> str:
        """The line of this frame."""
        return kitti_line(pose.world_from_cam)
