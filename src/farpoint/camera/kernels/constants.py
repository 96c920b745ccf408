"""Named constants of the lens-model kernels. A comment gives unit, meaning and origin of each.

The origin is "derived" (from what), "convention", "measured" (by what), or "chosen" where nothing
more is known.
"""

from __future__ import annotations

# Newton's method for the undistorted point (x, y) of a pixel stops at a step (dx, dy) with
# (|dx| + |dy|) / (1 + |x| + |y|) of at most this value. Chosen.
LENS_TOLERANCE = 1e-10

# Steps of the table of radii of a distorted plane, per unit of r / (1 + r). Chosen: Newton's method
# then takes two steps for a lens with little distortion.
LENS_TABLE_STEPS = 1024
