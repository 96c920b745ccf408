"""Relative pose of two views with its covariance: the method itself."""

from farpoint.pose.result import PoseStats, PoseStatus, RelativePose, TrackLabel

__all__ = ["PoseStats", "PoseStatus", "RelativePose", "TrackLabel"]
