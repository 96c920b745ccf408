"""Pictures for notebooks and papers: flow, epipole and trajectory on matplotlib axes.

Every function draws on the axes it is given, or on new ones, and returns them; what it drew can be
changed there as usual. Matplotlib is loaded by the first call.
"""

from farpoint.plot.epipole import epipole
from farpoint.plot.flow import flow
from farpoint.plot.trajectory import trajectory

__all__ = ["epipole", "flow", "trajectory"]
