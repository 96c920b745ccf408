"""Every number of the tracker that has a name: unit, meaning and origin.

Origin is "derived" (from what), "convention", "measured" (by what), or "chosen" where nothing more
is known.
"""

from __future__ import annotations

import numpy as np

# --- Windows and warps

# Largest window, px: time and memory are quadratic in it. Chosen.
MAX_WINDOW_PX = 255

# Step of differences of a predicted motion, px: half a window. Chosen.
WARP_STEP_PX = 4.0

# Largest deviation of an element of a predicted warp from the identity. Beyond, the identity is
# used. Chosen: larger ones occur at the seam of a panorama or the border of the lens' field.
MAX_PREDICTED_WARP = 0.5

# 1-sigma error of 8-bit quantisation and bilinear interpolation, px. Measured on noise-free images
# of known sub-pixel shift; the command is not recorded. The residual underestimates this error.
INTERPOLATION_SIGMA_PX = 0.01

# Sampling of the field of the lens, px. Chosen: 16 times faster than 1 px, and the region is 4 px
# narrower.
FIELD_STEP_PX = 4

# --- Start level of Lucas-Kanade

# Number of points tracked first, evenly spaced: their displacement sets the start level. Chosen.
PROBES = 40

# Least number of probes that are found. Chosen.
MIN_PROBES = 10

# Least share of the probes that are found. Chosen.
MIN_FOUND_SHARE = 0.5

# Quantile of the displacements of probes, which the start level must reach. Chosen.
PROBE_QUANTILE = 0.9

# Half width of the window at the start level, in px of the finest level, over that quantile, at
# least. Chosen: Lucas-Kanade converges reliably only within a part of the window.
REACH_MARGIN = 4.0

# --- Defective pixels

# Distance, px, to which demosaicing and compression spread a defect. Chosen.
DEFECT_REACH_PX = 1

# Distance, px, of the ring of pixels for comparison and interpolation. Derived: the nearest pixels
# that a defect does not change.
DEFECT_RING_PX = DEFECT_REACH_PX + 1

# Least difference, grey levels, between a defect and every pixel of the ring. Chosen: a smaller
# difference hardly biases a match.
MIN_DEFECT_CONTRAST = 6

# Number of first images, all of which are tested. Chosen.
FIRST_IMAGES = 20

# Of later images, one in this number is tested. Chosen: sensors age slowly.
LATER_EVERY = 4

# Image motion, px, after which a suspect is tested again: scene content that stands out is then at
# other pixels than in the last test. Chosen.
MIN_MOTION_PX = 1.0

# Distance along either axis, px, within which a track may lock onto a suspect. Chosen.
SUSPECT_PULL_PX = 5

# Number of nearest tracks, whose median displacement is the local image motion. Chosen.
MOTION_NEIGHBOURS = 5

# Probability that a defect stands out in one image. Chosen.
DETECTION_RATE = 0.8

# Expected false detections over a whole image. Chosen.
FALSE_DETECTIONS = 0.01

# Number of tested images without detection after which a defect is dropped. Chosen.
MAX_MISSES = 6

# --- Brightness of rows

# Pyramid level whose grey values are compared. Chosen.
BRIGHTNESS_LEVEL = 1

# Number of successive tracks in the order of rows: the median of all but the middle track predicts
# the brightness change of the middle track. Chosen.
ROW_NEIGHBOURS = 9

# Least number of tracks for the brightness of rows. Chosen.
MIN_ROW_TRACKS = 4 * ROW_NEIGHBOURS

# Least median absolute deviation of the log ratios of brightness for an estimate of row gains.
# Chosen: the gain of a matched window absorbs smaller changes.
MIN_ROW_DEVIATION = 0.02

# Largest median error of the prediction from neighbouring rows, over the median absolute deviation
# of the log ratios. Chosen.
MAX_UNEXPLAINED = 0.6

# Largest prediction error of an inlier, over the median error. Chosen.
ROW_INLIER_RATIO = 4.0

# Grey levels below which ratios are unreliable. Chosen.
DARK_GREY = 8.0

# Number of knots of the curve of log gain over the rows. Chosen.
ROW_KNOTS = 80

# Weights of the squared second differences of that curve that are tried. Chosen.
ROW_PENALTIES = 10.0 ** np.arange(-2, 5)

# Upper bound of the magnitude of a log gain. Chosen.
MAX_LOG_GAIN = 1.0

# Alternations of estimating row gains and matching. Chosen.
ROW_GAIN_ROUNDS = 2

# Number of images over which row gains are averaged, at most. Chosen.
MAX_AVERAGED_IMAGES = 20

# --- Kernels

# Parameters of the affine match. Derived: displacement (2), warp (4), gain and offset.
AFFINE_PARAMETERS = 8

# Distance to each side, px, that a window may move before the image is read again. Chosen.
WINDOW_SLACK_PX = np.int64(1)

# Pixels of a line of a warped window that are read at once. Chosen.
PIXELS_AT_ONCE = 16

# Largest half width or half height of a warped window, over that of the window. Chosen.
MAX_WINDOW_STRETCH = 2.0

# Noise variance of Scharr gradients over the noise variance of the residual, for white noise of
# variance s^2. Derived: bilinear interpolation reduces the variance of the gradient from 0.23 s^2
# to 0.13 s^2, and the difference of two interpolated images has the variance 0.88 s^2.
GRADIENT_NOISE_RATIO = 0.15

# Distance, px, from which on residuals of a window count as independent (see
# `window_covariance.covary`); `_block_moments` is written for the value 3. Chosen.
RESIDUAL_BLOCK_PX = 3

# Lower bound of the singular values of the median response (`refinement._with_response`). Chosen:
# the least in eight recordings is 0.43, in turns of a Kinect.
MIN_RESPONSE = 0.25
