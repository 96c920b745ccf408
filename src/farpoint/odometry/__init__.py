"""Visual odometry: motions from images. The package reads and writes no files."""

from farpoint.odometry.options import OdometryOptions
from farpoint.odometry.result import OdometryResult
from farpoint.odometry.sequence import Odometry
from farpoint.path.lens import LensReport
from farpoint.path.point import FinalPose

__all__ = ["FinalPose", "LensReport", "Odometry", "OdometryOptions", "OdometryResult"]
