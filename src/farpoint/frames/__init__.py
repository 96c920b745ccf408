"""Readers of frames: a reader for each kind of source. All readers yield `Frame` records."""

from farpoint.frames.focal_length import find_focal_length
from farpoint.frames.frame import Frame, FrameSource
from farpoint.frames.opening import open_frames

__all__ = ["Frame", "FrameSource", "find_focal_length", "open_frames"]
