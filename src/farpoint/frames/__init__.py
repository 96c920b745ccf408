"""Frames: one small reader for each kind of source, all yielding the same record."""

from farpoint.frames.frame import Frame, FrameSource

__all__ = ["Frame", "FrameSource"]
