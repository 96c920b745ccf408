"""farpoint: camera motion from any two images, with an honest covariance."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from farpoint.camera import Camera, load_camera
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

if TYPE_CHECKING:
    from farpoint import plot as plot
    from farpoint.frames import Frame, FrameSource, open_frames
    from farpoint.odometry import Odometry, OdometryOptions, OdometryResult
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

# Imported on first use: two-view estimates from matches do not need the image libraries.
_LATER = {
    "Frame": "farpoint.frames",
    "FrameSource": "farpoint.frames",
    "Odometry": "farpoint.odometry",
    "OdometryOptions": "farpoint.odometry",
    "OdometryResult": "farpoint.odometry",
    "Tracks": "farpoint.tracks",
    "open_frames": "farpoint.frames",
}

if not TYPE_CHECKING:  # a type checker must still report unknown names

    def __getattr__(name: str) -> object:
        if name == "plot":
            return importlib.import_module("farpoint.plot")
        if name in _LATER:
            return getattr(importlib.import_module(_LATER[name]), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__, "plot"})
