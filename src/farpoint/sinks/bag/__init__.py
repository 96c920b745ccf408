"""A run as messages of ROS 2 in an MCAP file."""

from farpoint.sinks.bag.sink import BagSink

__all__ = ["BagSink"]
