"""Live sessions: odometry of the frames of a live source, written to outputs."""

from farpoint.live.session import LiveSession, LiveState

__all__ = ["LiveSession", "LiveState"]
