"""Live frames: the newest frame is used, and dropped frames are counted."""

from farpoint.frames.live.account import LiveAccount
from farpoint.frames.live.capture import Capture, LiveFrame
from farpoint.frames.live.playback import Black, Disconnect, Fault, Playback, Stall
from farpoint.frames.live.source import LiveSource, open_live

__all__ = [
    "Black",
    "Capture",
    "Disconnect",
    "Fault",
    "LiveAccount",
    "LiveFrame",
    "LiveSource",
    "Playback",
    "Stall",
    "open_live",
]
