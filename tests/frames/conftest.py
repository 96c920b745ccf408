"""Makers of the videos and folders that the tests of this area read."""

from __future__ import annotations

from frames_kit import write_images, write_video

__all__ = ["write_images", "write_video"]
