"""farpoint: camera motion from any two images, with an honest covariance."""

from farpoint.camera import Camera, load_camera
from farpoint.pose import (
    PoseStats,
    PoseStatus,
    RelativePose,
    RelativePoseOptions,
    TrackLabel,
    estimate_relative_pose,
    estimate_relative_pose_from_rays,
    far_distance,
    observable_motion,
)

__all__ = [
    "Camera",
    "PoseStats",
    "PoseStatus",
    "RelativePose",
    "RelativePoseOptions",
    "TrackLabel",
    "estimate_relative_pose",
    "estimate_relative_pose_from_rays",
    "far_distance",
    "load_camera",
    "observable_motion",
]

__version__ = "0.1.0"
