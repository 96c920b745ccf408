"""Recordings of ROS 1, ROS 2 and MCAP as sources of images, read as streams."""

from farpoint.frames.bags.kinds import holds_bag, is_bag, is_bag_file, open_bag
from farpoint.frames.bags.records import Bag
from farpoint.frames.bags.source import BagImages, open_bag_images
from farpoint.frames.bags.topics import rows_of

__all__ = [
    "Bag",
    "BagImages",
    "holds_bag",
    "is_bag",
    "is_bag_file",
    "open_bag",
    "open_bag_images",
    "rows_of",
]
