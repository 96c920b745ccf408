"""Relative pose of two views, with its covariance."""

from farpoint.pose.conclusion import failed_pose
from farpoint.pose.metric import PoseOrder
from farpoint.pose.observable import far_distance, observable_motion
from farpoint.pose.options import RelativePoseOptions
from farpoint.pose.relative_pose import estimate_relative_pose, estimate_relative_pose_from_rays
from farpoint.pose.result import PoseStats, PoseStatus, RelativePose, TrackLabel

__all__ = [
    "PoseOrder",
    "PoseStats",
    "PoseStatus",
    "RelativePose",
    "RelativePoseOptions",
    "TrackLabel",
    "estimate_relative_pose",
    "estimate_relative_pose_from_rays",
    "failed_pose",
    "far_distance",
    "observable_motion",
]
