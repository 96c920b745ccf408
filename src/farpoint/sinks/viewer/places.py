"""Names of the entities in the recording, used by layout and drawing."""

from __future__ import annotations

__all__ = [
    "CAMERA",
    "CONE",
    "DELAYS",
    "FLOW",
    "HEADING",
    "IMAGE",
    "LINK",
    "PATH",
    "POINTS",
    "POSITION",
    "ROTATION",
    "STATUS",
    "VALUES",
    "WORLD",
]

IMAGE = "image"
"""The newer image with its tracks."""
FLOW = "flow"
"""The translational flow with the epipole, in the pixels of the older image."""
WORLD = "world"
CAMERA = "world/camera"
PATH = "world/path"
POINTS = "world/points"
POSITION = "world/position"
"""The 95 % region of the camera's position, by the errors since the beginning of the segment."""
CONE = "world/heading"
"""The 95 % region of the heading, from the previous position."""
ROTATION = "rotation"
"""Rate of rotation, deg/s: x, y, z, each with its value and its band."""
HEADING = "heading"
"""Direction of travel, deg: to the right and up, with their bands."""
STATUS = "status"
VALUES = "values"
DELAYS = "delays"
"""Latency and frames left out, of live sessions."""
LINK = "status/source"
"""State of the source, of live sessions."""
