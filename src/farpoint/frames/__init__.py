"""Frames: one small reader for each kind of source, all yielding the same record."""

from farpoint.frames.frame import Frame, FrameSource
from farpoint.frames.opening import open_frames

__all__ = ["Frame", "FrameSource", "open_frames"]
