"""Pictures for notebooks and papers: flow, epipole and trajectory on matplotlib axes.

Every function draws on the given axes, or on new axes, and returns the axes. The first call loads
Matplotlib.
"""

from farpoint.plot.epipole import epipole
from farpoint.plot.flow import flow
from farpoint.plot.trajectory import trajectory

__all__ = ["epipole", "flow", "trajectory"]
