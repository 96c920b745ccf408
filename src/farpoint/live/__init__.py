"""A source that is watched, through the odometry into outputs, as it happens."""

from farpoint.live.session import LiveSession, LiveState

__all__ = ["LiveSession", "LiveState"]
