"""Named constants of the kernels of synthetic scenes: meaning, unit and origin.

The origin is "derived" (from what), "convention", "measured" (by what), or "chosen" if no other
origin is known.
"""

from __future__ import annotations

import numpy as np

# Kinds of shapes. Convention: an enumeration.
BOX, CYLINDER, ELLIPSOID = range(3)

# Numbers of surfaces other than shapes. Shapes have the numbers 0, 1, 2, ..., and rings of hills
# have FIRST_RING, FIRST_RING - 1, ... Convention: an enumeration.
GROUND, SKY, NOTHING, FIRST_RING = range(-1, -5, -1)

# Number of the top face of a box; the bottom face has the next number. Derived: the sides have the
# numbers 0 to 3.
TOP_FACE = 4

# Index of the noise texture, which is on every surface at two scales. Convention.
NOISE_TEXTURE = 0

# Size of a texel of the noise texture at the fine scale, m. Chosen.
FINE_TEXEL_M = 0.011

# Size of a texel of the noise texture at the coarse scale, m. Chosen.
COARSE_TEXEL_M = 0.23

# Size of a texel of the clouds, divided by the height of the cloud layer. Chosen.
CLOUD_TEXEL = 0.012

# Amplitude of the clouds, grey levels. Chosen.
CLOUD_GAIN = 9.0

# Offset of the coarse and the fine noise texture between successive faces of a box, m. Chosen.
FACE_SHIFT_M = 7.3

# Lower bound of the cosine of the angle of incidence, for finite footprints at silhouettes. Chosen.
MIN_INCIDENCE_COSINE = 0.02

# Largest number of texture lookups along the major axis of a footprint. Chosen.
MAX_TEXTURE_LOOKUPS = 12

# Width of a texel of the mip level that is read, divided by the minor axis of the footprint of a
# pixel. Derived: the blur of a level has a sigma of 0.8 texels and the interpolation one of 0.4
# texels, so the sigma of the filter is 0.6 sqrt(0.8^2 + 0.4^2) = 0.54 px.
TEXEL_WIDTH_PX = 0.6

# Offset (1, 2), px, of the single sample of a pixel that is not at an edge. Derived: the centre.
PIXEL_CENTRE = np.zeros((1, 2))

# Number of samples of a pixel at an edge. Chosen.
EDGE_SAMPLES = 16

# Half width of the tent filter at an edge, px. Derived: the sigma of the tent filter, 1.25 /
# sqrt(6) = 0.51 px, is close to the sigma of the texture filter, 0.54 px.
EDGE_HALF_WIDTH_PX = 1.25

# Ratio of the width of the footprint of a sample at an edge to that of the whole pixel. Chosen.
EDGE_FOOTPRINT = 0.4
