"""Named constants of the kernels of synthetic scenes: meaning, unit and origin.

Origin is "derived" (from what), "convention", "measured" (by what), or "chosen" where nothing more
is known.
"""

from __future__ import annotations

import numpy as np

# Kinds of shapes. Convention: an enumeration.
BOX, CYLINDER, ELLIPSOID = range(3)

# Surfaces other than shapes; shapes are numbered from 0, rings of hills downwards from
# FIRST_RING. Convention: an enumeration.
GROUND, SKY, NOTHING, FIRST_RING = range(-1, -5, -1)

# Number of the top face of a box; the bottom is the next face. Derived: four sides before it.
TOP_FACE = 4

# Index of the noise texture on every surface, at two scales. Convention.
NOISE_TEXTURE = 0

# Size of a texel of the fine scale, m. Chosen.
FINE_TEXEL_M = 0.011

# Size of a texel of the coarse scale, m. Chosen.
COARSE_TEXEL_M = 0.23

# Size of a texel of the clouds, divided by the height of the cloud layer. Chosen.
CLOUD_TEXEL = 0.012

# Amplitude of the clouds, grey levels. Chosen.
CLOUD_GAIN = 9.0

# Offset of the noise texture between faces, m. Chosen.
FACE_SHIFT_M = 7.3

# Lower bound of the cosine of the angle of incidence: footprints stay finite at silhouettes.
# Chosen.
MIN_INCIDENCE_COSINE = 0.02

# Upper bound of the lookups along the major axis of a footprint. Chosen.
MAX_TEXTURE_LOOKUPS = 12

# Width of a texel of the mip level that is read, divided by the minor axis of the footprint of a
# pixel. Derived: the blur of a level has a sigma of 0.8 texels and the interpolation one of 0.4
# texels, so the sigma of the filter is 0.6 sqrt(0.8^2 + 0.4^2) = 0.54 px.
TEXEL_WIDTH_PX = 0.6

# Offset (1, 2), px, of the only sample of a pixel that is not at an edge. Derived.
PIXEL_CENTRE = np.zeros((1, 2))

# Samples of a pixel at an edge. Chosen.
EDGE_SAMPLES = 16

# Half-width of the tent filter at an edge, px. Derived: its sigma, 1.25 / sqrt(6) = 0.51 px, is
# close to the 0.54 px of the texture filter.
EDGE_HALF_WIDTH_PX = 1.25

# Footprint of one sample at an edge over that of the pixel. Chosen.
EDGE_FOOTPRINT = 0.4
