"""The sink ``trajectory.tum``: where the camera was, a line per frame."""

from __future__ import annotations

from farpoint.odometry import OdometryResult
from farpoint.sinks.sink import TextSink
from farpoint.trajectory.files import tum_line

__all__ = ["TrajectoryFile"]


class TrajectoryFile(TextSink):
    """Writes ``timestamp tx ty tz qx qy qz qw`` of ``world_from_cam``."""

    def lines(self, result: OdometryResult) -> str:
        """The line of this frame."""
        return tum_line(result.timestamp, result.world_from_cam)
