"""Images in, motions out: no files, no printing."""

from farpoint.odometry.options import OdometryOptions
from farpoint.odometry.result import OdometryResult
from farpoint.odometry.sequence import Odometry

__all__ = ["Odometry", "OdometryOptions", "OdometryResult"]
