"""farpoint: camera motion from any two images, with an honest covariance."""

from farpoint.camera import Camera, load_camera
from farpoint.frames import Frame, FrameSource, open_frames
from farpoint.odometry import Odometry, OdometryOptions, OdometryResult
from farpoint.pose import (
    PoseOrder,
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
from farpoint.tracks import Tracks

__all__ = [
    "Camera",
    "Frame",
    "FrameSource",
    "Odometry",
    "OdometryOptions",
    "OdometryResult",
    "PoseOrder",
    "PoseStats",
    "PoseStatus",
    "RelativePose",
    "RelativePoseOptions",
    "TrackLabel",
    "Tracks",
    "estimate_relative_pose",
    "estimate_relative_pose_from_rays",
    "far_distance",
    "load_camera",
    "observable_motion",
    "open_frames",
]

__version__ = "0.1.0"
