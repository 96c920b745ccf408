"""farpoint: camera motion from any two images, with an honest covariance."""

from __future__ import annotations

import importlib
from types import ModuleType
from typing import TYPE_CHECKING

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

if TYPE_CHECKING:
    from farpoint import plot as plot

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


if not TYPE_CHECKING:  # a type checker must still tell names that do not exist

    def __getattr__(name: str) -> ModuleType:
        """``farpoint.plot`` on first use: whoever only estimates need not wait for it."""
        if name == "plot":
            return importlib.import_module("farpoint.plot")
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
