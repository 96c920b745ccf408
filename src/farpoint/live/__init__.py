"""Live sessions: from a source through the odometry into outputs."""

from farpoint.live.session import LiveSession, LiveState

__all__ = ["LiveSession", "LiveState"]
